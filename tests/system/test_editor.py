"""What an editor shows of a manifest: yaml-language-server itself, asked as editors ask it."""

import json
import subprocess
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import pytest

from rarms_iac.app.manifest_files import write_first_manifest
from rarms_iac.storage.shipped import shipped_text

pytestmark = pytest.mark.needs("yaml-language-server")


class Editor:
    """The least that an editor says to a language server over its standard input and output."""

    def __init__(self, server: "subprocess.Popen[bytes]") -> None:
        self.server = server
        self.send("initialize", {"processId": None, "rootUri": None, "capabilities": {}}, identity=1)
        while "id" not in self.receive():
            pass
        self.send("initialized", {})

    def send(self, method: str, parameters: Any, identity: int | None = None) -> None:
        self._write({"method": method, "params": parameters} | ({} if identity is None else {"id": identity}))

    def _write(self, message: dict[str, Any]) -> None:
        body = json.dumps({"jsonrpc": "2.0", **message}).encode()
        assert self.server.stdin is not None
        self.server.stdin.write(b"Content-Length: %d\r\n\r\n%s" % (len(body), body))
        self.server.stdin.flush()

    def receive(self) -> dict[str, Any]:
        """The next message; what the server asks for is answered with nothing."""
        assert self.server.stdout is not None
        length = 0
        while line := self.server.stdout.readline().strip():
            if line.lower().startswith(b"content-length:"):
                length = int(line.split(b":")[1])
        message: dict[str, Any] = json.loads(self.server.stdout.read(length))
        if "id" in message and "method" in message:
            asked = message["params"].get("items", []) if isinstance(message["params"], dict) else []
            self._write({"id": message["id"], "result": [None] * len(asked)})
            return self.receive()
        return message

    def problems(self, file: Path) -> list[str]:
        """What the editor underlines in a file, each as `line: message`."""
        document = {"uri": file.as_uri(), "languageId": "yaml", "version": 1, "text": file.read_text(encoding="utf-8")}
        self.send("textDocument/didOpen", {"textDocument": document})
        while True:
            message = self.receive()
            if message.get("method") == "textDocument/publishDiagnostics" and message["params"]["uri"] == file.as_uri():
                problems = message["params"]["diagnostics"]
                return [f"{problem['range']['start']['line'] + 1}: {problem['message']}" for problem in problems]


@contextmanager
def an_editor() -> Iterator[Editor]:
    with subprocess.Popen(
        ["yaml-language-server", "--stdio"], stdin=subprocess.PIPE, stdout=subprocess.PIPE, stderr=subprocess.DEVNULL
    ) as server:
        try:
            yield Editor(server)
        finally:
            server.kill()


def test_editor_accepts_init_and_explains_quantities(tmp_path: Path) -> None:
    file = Path(write_first_manifest(str(tmp_path)).files[0])
    text = file.read_text(encoding="utf-8")
    wrong = tmp_path / "wrong.yaml"
    wrong.write_text(
        text.replace("memory: 4 GiB", "memory: 4")
        .replace("at_most: 50 ms", "at_most: 50 msec")
        .replace("reserve: 30 %", "reserve: 30"),
        encoding="utf-8",
    )

    with an_editor() as editor:
        assert editor.problems(file) == []
        problems = editor.problems(wrong)

    assert [problem.split(": ", 1)[1] for problem in problems] == [
        "Write a number above 0 with the unit B, KiB, MiB, GiB or TiB, for example `512 MiB`.",
        "Write a number with the unit us, ms, s, min or h, for example `88 ms`.",
        "Write `measured` or a number with the unit % or LP, for example `measured` or `70 %` or `1.4 LP`.",
    ]


def test_an_editor_knows_an_overlay(tmp_path: Path) -> None:
    (tmp_path / "overlay.schema.json").write_text(shipped_text("schemas/overlay.json"), encoding="utf-8")
    head = "# yaml-language-server: $schema=overlay.schema.json\n"
    right, wrong = tmp_path / "robot-7.yaml", tmp_path / "robot-8.yaml"
    right.write_text(f"{head}components:\n  door: null\n  arm: {{ memory: 1 GiB, task: null }}\n", encoding="utf-8")
    wrong.write_text(f"{head}components:\n  arm: {{ memory: 1 GB }}\n", encoding="utf-8")

    with an_editor() as editor:
        assert editor.problems(right) == []
        (problem,) = editor.problems(wrong)

    assert "the unit B, KiB, MiB, GiB or TiB" in problem
