"""A host that is reached over a real ssh: sshd on loopback, keys of its own, and the stand-in as its `pwsh`.

Everything lies in one folder. `ssh` finds its keys through a wrapper that comes first on the PATH of who calls rarms.
"""

from __future__ import annotations

import os
import shutil
import signal
import socket
import subprocess
import sys
import time
from collections.abc import Callable, Iterator, Mapping
from contextlib import contextmanager, suppress
from dataclasses import dataclass, field
from pathlib import Path

import pytest

from rarms_iac.storage.writing import hold
from tests.fake_powershell import program as powershell
from tests.fake_powershell.host import WindowsHost
from tests.needs import CHECKOUT

SECONDS = 20.0
SERVER = """\
Port {port}
ListenAddress 127.0.0.1
HostKey {folder}/host_key
AuthorizedKeysFile {folder}/key.pub
PidFile none
StrictModes no
UsePAM no
PasswordAuthentication no
LogLevel ERROR
SetEnv PATH={folder}/there:{path}
"""
CLIENT = """\
Host cell
    HostName 127.0.0.1
    Port {port}
    IdentityFile {folder}/key
    IdentitiesOnly yes
    UserKnownHostsFile {folder}/known
    StrictHostKeyChecking accept-new
    LogLevel ERROR
"""


@dataclass(frozen=True, slots=True)
class Ended:
    """How a command ended."""

    code: int
    out: str
    err: str

    def __str__(self) -> str:
        return f"exit {self.code}\n{self.out}\n{self.err}"


@dataclass(frozen=True, slots=True)
class Remote:
    """The folder of a running sshd and of the host behind it."""

    folder: Path
    server: subprocess.Popen[bytes] | None  # None: it is reached by WinRM, whose stand-in lies in the folder `winrm`
    variables: Mapping[str, str] = field(default_factory=dict)  # of who calls rarms, beside the usual

    @property
    def host(self) -> WindowsHost:
        return powershell.load(self.folder)

    def put(self, host: WindowsHost) -> None:
        """Have this host there, once nothing runs on it any more."""
        with hold(self.folder / powershell.LOCK, "a test", 30_000):
            powershell.save(self.folder, host)

    def ask(self, **how: object) -> None:
        powershell.ask(self.folder, **how)

    @property
    def pid(self) -> int:
        """Of the server."""
        assert self.server is not None
        return self.server.pid

    @property
    def environment(self) -> Mapping[str, str]:
        """Of who calls rarms."""
        path = f"{self.folder}/here{os.pathsep}{os.environ['PATH']}"
        usual = {**os.environ, "PATH": path, "PYTHONPATH": str(CHECKOUT), "NO_COLOR": "1"}
        return {**usual, **self.variables}

    def start(self, *words: str, with_pwsh: bool = False) -> subprocess.Popen[bytes]:
        """`rarms` as a process, in the host's folder; `with_pwsh`: on the host itself."""
        environment = dict(self.environment)
        if with_pwsh:
            environment["PATH"] = f"{self.folder}/there{os.pathsep}{environment['PATH']}"
        program = [sys.executable, "-m", "rarms_iac.cli.main"]
        pipe = subprocess.PIPE
        return subprocess.Popen(
            [*program, *words],
            cwd=self.folder,
            env=environment,
            stdin=subprocess.DEVNULL,
            stdout=pipe,
            stderr=pipe,
        )

    def rarms(self, *words: str, with_pwsh: bool = False) -> Ended:
        return finish(self.start(*words, with_pwsh=with_pwsh))

    def cut(self) -> None:
        """Break every connection, as if a cable were pulled: the sessions' processes end without a word."""
        for process in children(self.pid):
            os.kill(process, signal.SIGKILL)


def finish(process: subprocess.Popen[bytes]) -> Ended:
    """What became of it."""
    out, err = process.communicate(timeout=600)
    return Ended(process.returncode, out.decode("utf-8"), err.decode("utf-8"))


def children(parent: int) -> list[int]:
    """The processes that this one started."""
    found = []
    for path in Path("/proc").glob("[0-9]*/stat"):
        try:
            fields = path.read_text(encoding="utf-8").rpartition(")")[2].split()
        except OSError:
            continue  # it ended meanwhile
        if int(fields[1]) == parent:
            found.append(int(path.parent.name))
    return found


def descendants(parent: int) -> Iterator[int]:
    """The processes that this one started, and those that these started."""
    for child in children(parent):
        yield child
        yield from descendants(child)


@contextmanager
def a_remote(folder: Path, host: WindowsHost) -> Iterator[Remote]:
    """A server that is up, with this host behind it."""
    write_fake(folder)
    powershell.save(folder, host)
    with a_server(folder) as remote:
        yield remote


def by_winrm(folder: Path, host: WindowsHost) -> Remote:
    """This host behind the stand-in of pypsrp, which starts what it is asked to on this computer."""
    write_fake(folder)
    powershell.save(folder, host)
    path = f"{folder}/there{os.pathsep}{os.environ['PATH']}"
    packages = f"{CHECKOUT}/tests/fake_powershell/winrm{os.pathsep}{CHECKOUT}"
    return Remote(folder, None, {"PATH": path, "PYTHONPATH": packages, "CELL_PASSWORD": WINRM_PASSWORD})


WINRM_PASSWORD = "a secret of the plant"


def write_fake(folder: Path) -> None:
    """Have the stand-in of PowerShell in this folder, as `pwsh` of the other end."""
    fake = f'exec "{sys.executable}" -m tests.fake_powershell.program "{folder}" "$@"'
    write_script(folder / "there" / "pwsh", f'cd "{CHECKOUT}" && {fake}')


@contextmanager
def a_server(folder: Path, wrap: Callable[[list[str]], list[str]] = list) -> Iterator[Remote]:
    """A server that is up, of this machine and this user.

    Args:
        wrap: makes of the words that start it those that do so in surroundings of its own.
    """
    port = _free_port()
    for name in ("host_key", "key"):
        words = ["ssh-keygen", "-q", "-t", "ed25519", "-N", "", "-f", str(folder / name)]
        subprocess.run(words, check=True, stdin=subprocess.DEVNULL)
    write_script(folder / "here" / "ssh", f'exec {shutil.which("ssh")} -F "{folder}/client" "$@"')
    values = {"port": port, "folder": folder, "path": os.environ["PATH"]}
    (folder / "server").write_text(SERVER.format(**values), encoding="utf-8")
    (folder / "client").write_text(CLIENT.format(**values), encoding="utf-8")
    if os.geteuid() == 0:
        Path("/run/sshd").mkdir(exist_ok=True)  # where root's sshd locks itself in; a service would have made it
    words = wrap([shutil.which("sshd") or "/usr/sbin/sshd", "-D", "-e", "-f", str(folder / "server")])
    with _serving(folder, port, words) as server:
        yield Remote(folder, server)


@contextmanager
def _serving(folder: Path, port: int, words: list[str]) -> Iterator[subprocess.Popen[bytes]]:
    with (folder / "server.log").open("wb") as log:
        server = subprocess.Popen(words, stderr=log)
        try:
            _await(port, server, folder / "server.log")
            yield server
        finally:
            for process in children(server.pid):
                with suppress(ProcessLookupError):
                    os.kill(process, signal.SIGKILL)
            server.terminate()
            server.wait()


def _await(port: int, server: subprocess.Popen[bytes], log: Path) -> None:
    until = time.monotonic() + SECONDS
    while time.monotonic() < until:
        assert server.poll() is None, log.read_text(encoding="utf-8")
        with socket.socket() as listener:
            if listener.connect_ex(("127.0.0.1", port)) == 0:
                return
        time.sleep(0.05)
    raise AssertionError("sshd does not answer")


def _free_port() -> int:
    with socket.socket() as listener:
        listener.bind(("127.0.0.1", 0))
        return int(listener.getsockname()[1])


@pytest.fixture
def pwsh(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """`pwsh` on the PATH, as the stand-in whose host lies in the folder that it is started in."""
    fake = f'exec "{sys.executable}" -m tests.fake_powershell.program "$folder" "$@"'
    write_script(tmp_path / "bin" / "pwsh", f'folder="$PWD" && cd "{CHECKOUT}" && {fake}')
    monkeypatch.setenv("PATH", f"{tmp_path / 'bin'}{os.pathsep}{os.environ['PATH']}")


def write_script(path: Path, does: str) -> None:
    """Make a shell script that can be run."""
    path.parent.mkdir(exist_ok=True)
    path.write_text(f"#!/bin/sh\n{does}\n", encoding="utf-8", newline="\n")
    path.chmod(0o755)
