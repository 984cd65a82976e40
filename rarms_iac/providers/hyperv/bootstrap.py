"""The fixed command at the other end of ssh: its words, and the frame in which scripts come to its standard input.

`templates/powershell/bootstrap.ps1` says how the input is read there. The command's words are plain ASCII without
spaces or quotes, so that it means the same to cmd.exe, PowerShell and every other shell that sshd may start.
"""

import hashlib
import re
from base64 import b64encode
from collections.abc import Sequence
from functools import cache

from rarms_iac.powershell.templates import as_script, read
from rarms_iac.providers.interface import ScriptBundle, WaitLimits

SHELLS = ("pwsh", "powershell")

READY = "rarms-bootstrap/1 ready"
FAILED = "rarms-bootstrap/1 failed"
FAILED_CODE = 90
STOP = b"s"

_PROGRAMS = {"pwsh": "pwsh", "powershell": "powershell.exe"}
_NAME = re.compile(r"[a-z0-9][a-z0-9.-]*\.ps1")


def render_bootstrap() -> bytes:
    """The bootstrap as a reader sees it."""
    return as_script(read("bootstrap.ps1"))


@cache
def command() -> str:
    """A script without remarks and indentation: what really travels, before it is encoded."""
    lines = [line.strip() for line in read("bootstrap.ps1").splitlines()]
    return "\n".join(line for line in lines if line and not line.startswith("#"))


def program_of(shell: str) -> str:
    """The program behind `connect.shell`."""
    return _PROGRAMS[shell]


def remote_words(shell: str) -> tuple[str, ...]:
    """The command that ssh starts at the other end; `-InputFormat None` leaves its standard input to the bootstrap."""
    encoded = b64encode(command().encode("utf-16-le")).decode("ascii")
    options = ("-NoProfile", "-NonInteractive", "-InputFormat", "None", "-OutputFormat", "Text")
    return (program_of(shell), *options, "-EncodedCommand", encoded)


def arguments_of(script: str, waits: WaitLimits, *, abandoning: bool) -> tuple[str, ...]:
    """The arguments of a script that changes something; one out of an old journal may have no `-Force`."""
    force = ("-Force",) if "[switch] $Force" in script else ()
    lock = ("-LockTimeout", str(min(-(-waits.lock_ms // 1000), 999_999))) if waits.lock_ms > 0 else ()
    return ("-AsJson", *force, *lock, *(("-Abandon",) if abandoning else ()))


def frame(script: ScriptBundle, arguments: Sequence[str]) -> bytes:
    """The bytes for the bootstrap's standard input: lengths and digests first, then the scripts as they are.

    Raises:
        ValueError: a file has a name that the bootstrap would refuse.
    """
    names = [script.runs, *sorted(name for name in script.files if name != script.runs)]
    bodies = [script.files[name].encode("ascii") for name in names]
    for name in names:
        if not _NAME.fullmatch(name):
            raise ValueError(f"{name!r} cannot be a script's name")
    rows = [f"{name} {len(body)} {hashlib.sha256(body).hexdigest()}" for name, body in zip(names, bodies, strict=True)]
    table = "\n".join([" ".join(arguments), *rows]).encode("ascii")
    return b"".join([b"%08d" % len(table), table, *bodies])
