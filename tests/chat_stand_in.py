# SPDX-License-Identifier: Apache-2.0
"""A stand-in for a server with OpenAI's chat-completions API, on the loopback device."""

import json
import threading
from contextlib import suppress
from http.server import BaseHTTPRequestHandler, ThreadingHTTPServer
from typing import Any

from lerobot_owlxt5.commands.answer import MOST_ACTIONS
from lerobot_owlxt5.conversation.chat_server import MOST_BYTES


def completion(*calls: tuple[str, Any]) -> bytes:
    """An answer with calls of tools: each name, with its arguments as an object or as a text."""
    called = [
        {"id": str(number), "type": "function", "function": {"name": name, "arguments": _text(arguments)}}
        for number, (name, arguments) in enumerate(calls)
    ]
    message = {"role": "assistant", "content": None, "tool_calls": called}
    return json.dumps({"choices": [{"index": 0, "message": message}]}).encode()


def _text(arguments: Any) -> str:
    return arguments if isinstance(arguments, str) else json.dumps(arguments)


GARBAGE = [
    *(b"", b"\xff\xfe", b"<html>", b"[]", b"null", b'{"choices": []}', b"[" * 50_000, b"1" * 5_000),
    b'{"choices": [{"message": {"content": "I push the mug."}}]}',
    b'{"choices": [{"message": {"tool_calls": "push"}}]}',
    b'{"choices": [{"message": {"tool_calls": [{"function": null}]}}]}',
    completion(("move", "{")),
    completion(("move", "[]")),
    completion(("fly", {})),
    completion(("move", {"object": "mug"})),
    completion(("move", {"verb": "throw", "object": "mug"})),
    completion(("move", {"verb": "push", "object": "mug", "speed": "high"})),
    completion(("move", {"verb": "push", "object": ["mug"]})),
    completion(("move", {"verb": ["push"], "object": "mug"})),
    completion(("move", {"verb": "push", "object": "mug\n" + "m" * 300})),
    completion(("move", {"verb": "push", "object": "mug"}), ("fly", {})),
    completion(("move", {"verb": "push", "object": "mug"}), ("home", {})),
    completion(("say", {"text": "x" * 300})),
    completion(("say", {"text": "\ud800"})),
    completion(*[("move", {"verb": "push", "object": "mug"})] * (MOST_ACTIONS + 1)),
    completion(("move", {"verb": "push", "object": "mug"})) + b" " * MOST_BYTES,  # huge
]
"""Answers that a robot can make nothing of."""


class ChatStandIn(ThreadingHTTPServer):
    """Serves on a free port until `close`; tests set and read its attributes.

    Attributes:
        answer: What it answers next.
        status: With this HTTP status.
        drips: Seconds between the bytes of its answer, headers included; 0: all at once.
        requests: What came: path, bearer token, content.
    """

    daemon_threads = True

    def __init__(self) -> None:
        super().__init__(("127.0.0.1", 0), _Handler)
        self.answer, self.status, self.drips = b"", 200, 0.0
        self.requests: list[tuple[str, str, Any]] = []
        threading.Thread(target=self.serve_forever, args=(0.01,), daemon=True).start()

    @property
    def url(self) -> str:
        return f"http://127.0.0.1:{self.server_port}/v1"

    def close(self) -> None:
        self.shutdown()
        self.server_close()


class _Handler(BaseHTTPRequestHandler):
    server: ChatStandIn

    def log_message(self, format: str, *args: object) -> None:
        pass

    def do_POST(self) -> None:
        body = self.rfile.read(int(self.headers["Content-Length"]))
        self.server.requests.append((self.path, self.headers.get("Authorization", ""), json.loads(body)))
        answer, pause = self.server.answer, threading.Event()
        lines = [
            f"HTTP/1.0 {self.server.status} Whatever",
            f"Content-Length: {len(answer)}",
            f"Location: {self.server.url}/elsewhere",
            "\r\n",
        ]
        sent = "\r\n".join(lines).encode() + answer
        with suppress(OSError):  # who asked may be gone
            if not self.server.drips:
                self.wfile.write(sent)
                return
            for letter in sent:
                self.wfile.write(bytes([letter]))
                pause.wait(self.server.drips)

    def do_GET(self) -> None:
        """Who follows a redirect comes here."""
        self.server.requests.append((self.path, self.headers.get("Authorization", ""), None))
        self.send_error(404)
