"""A shell that starts programs of this computer; no service answers at `refused`."""

import os
import select
import shutil
import subprocess

from pypsrp.exceptions import AuthenticationError, WinRMError
from pypsrp.wsman import WSMan

LARGEST = 150 * 2**10
"""Bytes of a message with its data in base64, as a WinRM service takes them by default."""


class CommandState:
    DONE = "Done"
    PENDING = "Pending"
    RUNNING = "Running"


class SignalCode:
    TERMINATE = "terminate"


class WinRS:
    def __init__(self, wsman: WSMan, codepage: int | None = None) -> None:
        self.wsman = wsman
        self.codepage = codepage
        self.opened = False

    def __enter__(self) -> "WinRS":
        if self.wsman.server == "refused":
            raise ConnectionRefusedError(111, "Connection refused")
        if self.wsman.username is not None and self.wsman.password != "a secret of the plant":
            raise AuthenticationError("Failed to authenticate the user")
        if self.wsman.username is None and self.wsman.auth != "kerberos":
            raise AuthenticationError("no user")
        self.opened = True
        return self

    def __exit__(self, *error: object) -> None:
        self.opened = False


class Process:
    def __init__(self, shell: WinRS, executable: str, arguments: list[str]) -> None:
        self.shell = shell
        self.words = [executable, *arguments]
        self.state = CommandState.PENDING
        self.rc: int | None = None
        self.stdout = b""
        self.stderr = b""
        self._begun = False

    def begin_invoke(self) -> None:
        pipe = subprocess.PIPE
        assert len(" ".join(self.words)) < 8191, "the shell is cmd.exe"
        words = (
            [word.strip('"') for word in self.words]  # as a program of Windows takes its command line apart
            if shutil.which(self.words[0])
            else ["sh", "-c", f"echo {self.words[0]} is not known >&2; exit 1"]
        )
        self._process = subprocess.Popen(words, stdin=pipe, stdout=pipe, stderr=pipe)
        streams = (self._process.stdout, self._process.stderr)
        self._open = [stream for stream in streams if stream is not None]

    def send(self, data: bytes, end: bool = True) -> None:
        assert not end
        assert len(data) * 4 / 3 < LARGEST
        assert self._process.stdin is not None
        self._process.stdin.write(data)
        self._process.stdin.flush()

    def poll_invoke(self, timeout: int | None = None) -> None:
        if os.environ.get("WINRM_BREAKS") and self._begun:
            self._process.kill()
            raise WinRMError("the connection was reset")
        for stream in select.select(self._open, [], [], min(float(timeout or 20), 0.2))[0]:
            data = os.read(stream.fileno(), 2**16)
            if not data:
                self._open.remove(stream)
            if stream is self._process.stdout:
                self.stdout += data
                self._begun = self._begun or b'"begun"' in data
            else:
                self.stderr += data
        if not self._open:
            self.state, self.rc = CommandState.DONE, self._process.wait()

    def signal(self, code: str) -> None:
        assert code == SignalCode.TERMINATE
        self._process.kill()
        self._process.wait()
