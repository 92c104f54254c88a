# SPDX-License-Identifier: Apache-2.0
"""A stand-in for the Hugging Face Hub on the loopback device: what pushing and loading a dataset takes."""

import base64
import hashlib
import json
from dataclasses import dataclass, field
from http.server import BaseHTTPRequestHandler, ThreadingHTTPServer
from typing import Any
from urllib.parse import parse_qs, unquote, urlsplit

TOKEN = "hf_thisTokenIsSecretAndMustNeverBePrinted"


@dataclass
class Repository:
    """Commits are whole trees, from path to content; the first one is the Hub's own."""

    private: bool
    commits: list[dict[str, bytes]] = field(default_factory=lambda: [{".gitattributes": b""}])
    tags: dict[str, int] = field(default_factory=dict)

    def find(self, revision: str) -> int | None:
        """Number of the commit that a branch, a tag or a hash names."""
        numbers = {"main": len(self.commits) - 1} | self.tags
        return numbers.get(revision, int(revision, 16) if len(revision) == 40 else None)


class HubServer(ThreadingHTTPServer):
    """Serves on a free port; tests look into its attributes.

    Attributes:
        repositories: By name, such as `me/clant`.
        stored: Large files by their SHA-256.
        received: SHA-256 of each large file, in the order of their arrival.
        accepts: How many large files to take before the connection breaks; None: all.
    """

    def __init__(self) -> None:
        super().__init__(("127.0.0.1", 0), _Handler)
        self.repositories: dict[str, Repository] = {}
        self.stored: dict[str, bytes] = {}
        self.received: list[str] = []
        self.accepts: int | None = None

    @property
    def url(self) -> str:
        return f"http://127.0.0.1:{self.server_port}"


class _Handler(BaseHTTPRequestHandler):
    server: HubServer

    def log_message(self, format: str, *args: object) -> None:
        pass

    def answer(self, status: int, content: Any = None, **headers: str) -> None:
        body = content if isinstance(content, bytes) else json.dumps(content or {}).encode()
        self.send_response(status)
        self.send_header("Content-Length", str(len(body)))
        for name, value in headers.items():
            self.send_header(name.replace("_", "-"), value)
        self.end_headers()
        if self.command != "HEAD":
            self.wfile.write(body)

    def handle_request(self) -> None:
        body = self.rfile.read(int(self.headers.get("Content-Length", 0)))
        parts = [unquote(part) for part in urlsplit(self.path).path.strip("/").split("/")]
        if parts[0] == "lfs":
            return self.store(parts[1], body)
        if self.headers.get("Authorization") != f"Bearer {TOKEN}":
            return self.answer(401, {"error": "Invalid credentials"})
        match self.command, *parts:
            case "POST", "api", "repos", "create":
                self.create(json.loads(body))
            case "POST", "api", "validate-yaml":
                self.answer(200, {"warnings": [], "errors": []})
            case _, "api", "datasets", user, name, *rest:
                self.repository(f"{user}/{name}", rest, body)
            case "POST", "datasets", _, _, "info", "lfs", "objects", "batch":
                self.batch(json.loads(body))
            case _, "datasets", user, name, "resolve", revision, *path:
                self.resolve(f"{user}/{name}", revision, "/".join(path))
            case _:
                self.answer(501, {"error": f"not part of the stand-in: {self.command} {self.path}"})

    do_DELETE = do_GET = do_HEAD = do_POST = do_PUT = handle_request  # noqa: N815

    def create(self, request: dict[str, Any]) -> None:
        if request["organization"] != "me":
            return self.answer(403, {"error": "You don't have the rights to create a dataset here"})
        name = f"me/{request['name']}"
        private = request.get("visibility") == "private" or request.get("private", False)
        status = 409 if name in self.server.repositories else 200
        self.server.repositories.setdefault(name, Repository(private))
        self.answer(status, {"url": f"{self.server.url}/datasets/{name}"})

    def repository(self, name: str, rest: list[str], body: bytes) -> None:
        repository = self.server.repositories.get(name)
        if repository is None:
            return self.answer(404, X_Error_Code="RepoNotFound")
        match self.command, *rest:
            case ("GET",):
                self.info(name, repository, "main")
            case "GET", "revision", revision:
                self.info(name, repository, revision)
            case "GET", "refs":
                tags = [
                    {"name": tag, "ref": f"refs/tags/{tag}", "targetCommit": f"{number:040x}"}
                    for tag, number in repository.tags.items()
                ]
                self.answer(200, {"branches": [], "converts": [], "tags": tags})
            case "GET", "tree", revision:
                assert "recursive" in parse_qs(urlsplit(self.path).query)
                files = repository.commits[repository.find(revision)]
                self.answer(200, [_entry(path, content) for path, content in files.items()])
            case "POST", "preupload", "main":
                files = json.loads(body)["files"]
                answers = [
                    {"path": file["path"], "uploadMode": _mode(file["path"]), "shouldIgnore": False}
                    for file in files
                ]
                self.answer(200, {"files": answers})
            case "POST", "commit", "main":
                self.commit(name, repository, [json.loads(line) for line in body.splitlines()])
            case "POST", "tag", revision:
                repository.tags[json.loads(body)["tag"]] = repository.find(revision)
                self.answer(200)
            case "DELETE", "tag", tag:
                if repository.tags.pop(tag, None) is None:
                    return self.answer(404, X_Error_Code="RevisionNotFound")
                self.answer(200)
            case _:
                self.answer(501, {"error": f"not part of the stand-in: {self.command} {self.path}"})

    def info(self, name: str, repository: Repository, revision: str) -> None:
        number = repository.find(revision)
        if number is None:
            return self.answer(404, X_Error_Code="RevisionNotFound")
        self.answer(200, {"id": name, "private": repository.private, "sha": f"{number:040x}"})

    def batch(self, request: dict[str, Any]) -> None:
        objects = request["objects"]
        for item in objects:
            if item["oid"] not in self.server.stored:
                item["actions"] = {"upload": {"href": f"{self.server.url}/lfs/{item['oid']}"}}
        self.answer(200, {"transfer": "basic", "objects": objects})

    def store(self, oid: str, body: bytes) -> None:
        if self.server.accepts is not None and len(self.server.received) >= self.server.accepts:
            self.close_connection = True  # without any answer
            return
        assert hashlib.sha256(body).hexdigest() == oid
        self.server.received.append(oid)
        self.server.stored[oid] = body
        self.answer(200)

    def commit(self, name: str, repository: Repository, lines: list[dict[str, Any]]) -> None:
        files = dict(repository.commits[-1])
        for line in lines:
            value = line["value"]
            match line["key"]:
                case "file":
                    files[value["path"]] = base64.b64decode(value["content"])
                case "lfsFile":
                    files[value["path"]] = self.server.stored[value["oid"]]
                case "deletedFile":
                    del files[value["path"]]
        repository.commits.append(files)
        oid = f"{len(repository.commits) - 1:040x}"
        self.answer(200, {"commitOid": oid, "commitUrl": f"{self.server.url}/datasets/{name}/commit/{oid}"})

    def resolve(self, name: str, revision: str, path: str) -> None:
        repository = self.server.repositories[name]
        number = repository.find(revision)
        content = repository.commits[number].get(path)
        if content is None:
            return self.answer(404, X_Error_Code="EntryNotFound")
        self.answer(200, content, ETag=f'"{_entry(path, content)["oid"]}"', X_Repo_Commit=f"{number:040x}")


def _mode(path: str) -> str:
    return "lfs" if path.endswith((".parquet", ".mp4", ".jpg")) else "regular"


def _entry(path: str, content: bytes) -> dict[str, Any]:
    digest = hashlib.sha256(content).hexdigest()
    return {"type": "file", "path": path, "size": len(content), "oid": digest[:40]}
