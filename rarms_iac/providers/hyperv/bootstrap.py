"""The fixed command at the other end of ssh: its words, and the frame in which all else comes to its standard input.

`templates/powershell/loader.ps1.j2` and the module's `Receive-RarmsPlan` say how the input is read there. The command's
words are plain ASCII without spaces or quotes, so that it means the same to cmd.exe, PowerShell and every other shell
that sshd may start.
"""

import hashlib
import re
from base64 import b64encode
from collections.abc import Sequence
from dataclasses import dataclass
from functools import cache

from rarms_iac.model.host import Receiver, Shell
from rarms_iac.model.version import __version__
from rarms_iac.powershell.templates import as_script, fill, receiver_text, template_text
from rarms_iac.providers.interface import ScriptBundle, WaitLimits

SHELLS = ("pwsh", "powershell")
WINDOWS_POWERSHELL: Shell = "powershell"

READY = "rarms-bootstrap/1 ready"
ANSWERS = "rarms-receiver/1 "
"""Begins the line by which an installed module answers: `ready` and its version, or `has` and those that are there."""
INSTALLED_FILE = r"C:\Program Files\WindowsPowerShell\Modules\Rarms\receive.ps1"
FAILED = "rarms-bootstrap/1 failed"
FAILED_CODE = 90
STOP = b"s"
NO_MORE = b"o"
"""Said behind the scripts where the input ends at once and the script is to go on all the same."""

PROGRAMS = {"pwsh": "pwsh", "powershell": "powershell.exe"}
_NAME = re.compile(r"[a-z0-9][a-z0-9.-]*\.ps1|Rarms/Rarms\.ps[dm]1")


def render_receiver() -> bytes:
    """Return what takes scripts from standard input and runs the first: its text travels ahead of them."""
    return fill("bootstrap.ps1.j2", {"receiver": receiver_text()})


def render_loader() -> bytes:
    """Return what ssh starts, as a reader sees it: it runs the receiver of exactly this version."""
    return fill("loader.ps1.j2", {"digest": hashlib.sha256(render_receiver()).hexdigest().upper()})


@cache
def command() -> str:
    """Return the loader without remarks and indentation: what the command holds, before it is encoded."""
    lines = [line.strip() for line in render_loader().decode("ascii").splitlines()]
    return "\n".join(line for line in lines if line and not line.startswith("#"))


def render_installed_receiver() -> bytes:
    """Return the script that starts the receiver of an installed module.

    A user signs it, and lays it above the versions.
    """
    return as_script(template_text("receive.ps1"))


@dataclass(frozen=True, slots=True)
class RemotePowerShell:
    """What is started at the other end: a PowerShell, and in it what takes scripts from standard input."""

    shell: str
    receiver: Receiver = Receiver.SENT

    @property
    def program(self) -> str:
        """The name of the PowerShell, as the command starts it."""
        return PROGRAMS[self.shell]

    def words(self) -> tuple[str, ...]:
        """Return the command; `-InputFormat None` leaves its standard input to the loader or the module."""
        options = ("-NoProfile", "-NonInteractive", "-InputFormat", "None", "-OutputFormat", "Text")
        if self.receiver is Receiver.SENT:
            return (self.program, *options, "-EncodedCommand", b64encode(command().encode("utf-16-le")).decode("ascii"))
        file = ("-ExecutionPolicy", "RemoteSigned", "-File", f'"{INSTALLED_FILE}"', "-Version", __version__)
        return (self.program, *options, *file)

    def is_answer(self, line: str) -> bool:
        """Whether the line says that scripts can come, or why not."""
        return line == READY if self.receiver is Receiver.SENT else line.startswith(ANSWERS)

    def other_versions(self, line: str) -> str:
        """Which versions of the module are there instead of this one, empty where it is ready."""
        if self.receiver is Receiver.SENT or line == f"{ANSWERS}ready {__version__}":
            return ""
        return line.removeprefix(ANSWERS).partition(" ")[2].strip() or "none"

    def frame(self, script: ScriptBundle, arguments: Sequence[str]) -> bytes:
        """Return the bytes for standard input: the receiver, then lengths and digests, then the scripts.

        Raises:
            ValueError: a file has a name that the receiver would refuse.
        """
        names = [script.runs, *sorted(name for name in script.files if name != script.runs)]
        bodies = [script.files[name].encode("ascii") for name in names]
        rows: list[str] = []
        for name, body in zip(names, bodies, strict=True):
            if not _NAME.fullmatch(name):
                raise ValueError(f"{name!r} cannot be a script's name")
            rows.append(f"{name} {len(body)} {hashlib.sha256(body).hexdigest()}")
        table = "\n".join([" ".join(arguments), *rows]).encode("ascii")
        parts = [table] if self.receiver is Receiver.INSTALLED else [render_receiver(), table]
        return b"".join([b"%08d" % len(part) + part for part in parts] + bodies)


def arguments_of(waits: WaitLimits, *, abandoning: bool) -> tuple[str, ...]:
    """Return the arguments of a script that changes something."""
    lock = ("-LockTimeout", str(min(-(-waits.lock_ms // 1000), 999_999))) if waits.lock_ms > 0 else ()
    return ("-AsJson", "-Force", *lock, *(("-Abandon",) if abandoning else ()))
