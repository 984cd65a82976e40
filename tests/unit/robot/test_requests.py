"""What a robot takes from the other side, and when it refuses to run at all."""

import io
import json
import os
import tempfile
import time
from collections.abc import Iterator
from pathlib import Path
from queue import SimpleQueue
from threading import Event, Thread
from typing import Any

import pytest

from rarms_iac.app.use_case_errors import UseCaseError
from rarms_iac.cli.ending import Interrupts
from rarms_iac.model.version import __version__
from rarms_iac.providers.robot import LINE_LIMIT, Request
from rarms_iac.robot.__main__ import listen, read_request, refuse_writable_code, set_environment
from rarms_iac.robot.caller import Caller
from rarms_iac.storage.codec import encode
from tests.builders import a_host
from tests.needs import require


def line_of(**changes: Any) -> bytes:
    request = Request(version=__version__, command="look", by="ann", host=a_host(), listens=True, job=7)
    return json.dumps({**encode(request), **changes}).encode() + b"\n"  # type: ignore[dict-item]


def test_a_request_is_read() -> None:
    request = read_request(io.BytesIO(line_of()))

    assert (request.command, request.host, request.job) == ("look", a_host(), 7)


@pytest.mark.parametrize(
    ("data", "message"),
    [
        (b"", "cannot be read"),
        (b"\xff\xfe\n", "cannot be read"),
        (b"GET / HTTP/1.1\n", "cannot be read"),
        (line_of()[:-1], "not one line"),
        (b'"' + b"x" * LINE_LIMIT + b'"\n', f"at most {LINE_LIMIT:,} bytes"),
        (b"[" * 100_000 + b"\n", "nested too deeply"),
        (b'{"job":1}\n', "cannot be read"),
        (line_of(version="0.0.9"), "is for rarms 0.0.9"),
        (line_of(command="__import__"), "the request __import__"),
    ],
    ids=["nothing", "bytes", "http", "cut", "64MiB", "deep", "empty", "version", "command"],
)
def test_garbage_is_not_a_request(data: bytes, message: str) -> None:
    with pytest.raises(UseCaseError) as raised:
        read_request(io.BytesIO(data))

    assert message in str(raised.value.findings[0].detail)


@pytest.fixture
def folder_of_root() -> Iterator[Path]:
    """A folder below folders that root alone can write to, which those of pytest are not."""
    require("root", "linux")
    with tempfile.TemporaryDirectory(prefix="rarms-test-", dir="/opt") as folder:
        yield Path(folder)


def test_code_that_others_can_write_is_refused(folder_of_root: Path) -> None:
    folder = folder_of_root / "version"
    (folder / "rarms_iac" / "app").mkdir(parents=True)
    code = folder / "rarms_iac" / "app" / "applying.py"
    code.touch()
    link = folder_of_root / "current"
    link.symlink_to(folder)
    refuse_writable_code(link / "rarms_iac", ())

    for path, mode, owner in ((code, 0o646, 0), (folder, 0o757, 0), (code.parent, 0o755, 4242)):
        before = path.stat().st_mode
        path.chmod(mode)
        os.chown(path, owner, owner)
        with pytest.raises(UseCaseError) as raised:
            refuse_writable_code(link / "rarms_iac", ())
        assert f"users other than root may write to {path}" in str(raised.value.findings[0].detail)
        path.chmod(before)
        os.chown(path, 0, 0)


@pytest.mark.parametrize(("says", "is_stopped"), [(b"", True), (b"here\n", True), (b"all sent\n", False), (None, True)])
def test_a_side_that_is_gone_stops_the_command(
    says: bytes | None, *, is_stopped: bool, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Its input ends; None: it does not end, and nothing comes."""
    stopped, ended = SimpleQueue[int](), Event()
    monkeypatch.setattr(os, "kill", lambda _process, number: stopped.put(number))
    reading, writing = os.pipe()
    caller = Caller(lambda _answer: None, Interrupts(), listens=True, answers=SimpleQueue())
    with os.fdopen(reading, "rb") as lines:
        listener = Thread(target=listen, args=(lines, caller, ended, 0.2 if says is None else 600.0))
        listener.start()
        if says is not None:
            os.write(writing, says)
            os.close(writing)
            listener.join(60)
            assert caller.answers.get(timeout=60) is False
        if is_stopped:
            assert stopped.get(timeout=60)
        time.sleep(0.5)
        assert stopped.empty(), "a second signal would end the running step"
        ended.set()
        if says is None:
            os.close(writing)
            listener.join(60)


def test_variables_of_the_robot_are_read(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("PATH", "")
    monkeypatch.delenv("CAMERA_KEY", raising=False)
    monkeypatch.setattr("rarms_iac.robot.__main__.refuse_writable", lambda _paths: None)
    file = tmp_path / "environment"

    file.write_text("# of the camera\n\nCAMERA_KEY=a=b\n", encoding="utf-8")
    set_environment(file)
    assert os.environ["CAMERA_KEY"] == "a=b"

    file.write_text("CAMERA_KEY\n", encoding="utf-8")
    with pytest.raises(UseCaseError) as raised:
        set_environment(file)
    assert "line 1" in str(raised.value.findings[0].detail)
