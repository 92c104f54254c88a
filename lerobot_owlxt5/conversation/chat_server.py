# SPDX-License-Identifier: Apache-2.0
"""One bounded request to a server with OpenAI's chat-completions API: llama.cpp, vLLM, Ollama, OpenAI.

Fields of request and answer: OpenAI's API reference, "Create chat completion", with `tools`.
"""

import json
import threading
from collections.abc import Sequence
from dataclasses import dataclass, field
from queue import Empty, SimpleQueue
from time import monotonic
from typing import Any
from urllib.parse import urlsplit
from urllib.request import HTTPRedirectHandler, Request, build_opener

TIMEOUT_SECONDS = 15.0
"""A request takes no longer: the robot waits for it (our decision)."""
MOST_BYTES = 65_536
"""A longer answer is not read (our decision)."""


class NotReachedError(Exception):
    """The server gave no answer in time, or one that says that something is wrong."""


class UnusableError(Exception):
    """The server's answer is none of the API's, or it is too long."""


@dataclass(frozen=True)
class Call:
    """What a model wants to be done, as it wrote it: nobody has checked it.

    Attributes:
        name: Of the tool.
        arguments: Of the tool.
    """

    name: str
    arguments: dict[str, Any]


class _NoRedirect(HTTPRedirectHandler):
    """urllib would send the key along, to whatever host a redirect names."""

    def redirect_request(self, *_: Any, **__: Any) -> None:
        """Follow none: it counts as an error."""


@dataclass(frozen=True)
class ChatServer:
    """A server and a model of it.

    Attributes:
        url: What stands before `/chat/completions`, such as `http://127.0.0.1:8080/v1`.
        model: Its name, as the server knows it.
        key: Sent as the bearer token; empty for a server that needs none.
        timeout: Of a request, seconds.
    """

    url: str
    model: str
    key: str = field(default="", repr=False)
    timeout: float = TIMEOUT_SECONDS

    def __post_init__(self) -> None:
        """Check what somebody typed.

        Raises:
            ValueError: If it cannot be an address or a key. The message has no key.
        """
        try:
            parts = urlsplit(self.url)
        except ValueError:
            parts = urlsplit("")
        if parts.scheme not in ("http", "https") or not parts.hostname or "@" in parts.netloc:
            raise ValueError(
                "the planner's address must be one such as http://127.0.0.1:8080/v1, without a password"
            )
        if not all("!" <= letter <= "~" for letter in self.key):
            raise ValueError("the planner's key must have plain letters, digits and marks, and no space")

    @property
    def host(self) -> str:
        """Host and port, as typed."""
        return urlsplit(self.url).netloc

    def ask(self, messages: Sequence[dict[str, str]], tools: Sequence[dict[str, Any]]) -> list[Call]:
        """Ask which tools to call.

        Args:
            messages: `role` and `content` of each, the oldest first.
            tools: Their schemas.

        Returns:
            The calls, in their order; empty if the model calls none.

        Raises:
            NotReachedError: If there is no answer within `timeout`, or an HTTP error.
            UnusableError: If the answer is longer than `MOST_BYTES`, or none of this API.
        """
        content = {"model": self.model, "messages": [*messages], "tools": [*tools], "tool_choice": "required"}
        return _read_calls(self._post(json.dumps(content).encode()))

    def _post(self, body: bytes) -> bytes:
        """Wait for an answer in another thread: urllib's timeout begins anew with each byte that comes."""
        answers: SimpleQueue[bytes | Exception] = SimpleQueue()

        def get() -> None:
            try:
                answers.put(self._get(body))
            except Exception as error:  # whatever it is, it is raised where somebody waits
                answers.put(error)

        threading.Thread(target=get, name="planner", daemon=True).start()
        try:
            answer = answers.get(timeout=self.timeout)
        except Empty:
            raise NotReachedError(f"no answer within {self.timeout:g} s") from None
        if isinstance(answer, UnusableError):
            raise answer
        if isinstance(answer, Exception):  # urllib and http.client have many of their own
            raise NotReachedError(f"{type(answer).__name__}: {answer}") from None
        return answer

    def _get(self, body: bytes) -> bytes:
        headers = {"Content-Type": "application/json"}
        if self.key:
            headers["Authorization"] = f"Bearer {self.key}"
        request = Request(f"{self.url.rstrip('/')}/chat/completions", body, headers)
        end, read = monotonic() + self.timeout, bytearray()
        with build_opener(_NoRedirect).open(request, timeout=self.timeout) as response:
            while part := response.read1(MOST_BYTES):
                read += part
                if len(read) > MOST_BYTES:
                    raise UnusableError(f"an answer of more than {MOST_BYTES} bytes")
                if monotonic() > end:
                    break  # nobody waits any more
        return bytes(read)


def _read_calls(answer: bytes) -> list[Call]:
    try:
        calls = json.loads(answer)["choices"][0]["message"].get("tool_calls") or []
        return [_read_call(call["function"]) for call in calls]
    # What is no JSON, or JSON of another form, or nested without end.
    except (ValueError, LookupError, TypeError, AttributeError, RecursionError) as error:
        raise UnusableError(f"{type(error).__name__} in an answer of {len(answer)} bytes") from None


def _read_call(function: dict[str, Any]) -> Call:
    name, arguments = function["name"], function.get("arguments") or "{}"
    if isinstance(arguments, str):
        arguments = json.loads(arguments)
    if not isinstance(name, str) or not isinstance(arguments, dict):
        raise TypeError
    return Call(name, arguments)
