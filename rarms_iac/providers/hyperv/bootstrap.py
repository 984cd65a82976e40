"""The fixed command at the other end of ssh: its words, and the frame in which all else comes to its standard input.

`templates/powershell/loader.ps1.j2` and `bootstrap.ps1`, the receiver, say how the input is read there. The command's
words are plain ASCII without spaces or quotes, so that it means the same to cmd.exe, PowerShell and every other shell
that sshd may start.
"""

import hashlib
import re
from base64 import b64encode
from collections.abc import Sequence
from functools import cache

from rarms_iac.powershell.templates import as_script, fill, read
from rarms_iac.providers.interface import ScriptBundle, WaitLimits

SHELLS = ("pwsh", "powershell")
WINDOWS_POWERSHELL = SHELLS[1]

READY = "rarms-bootstrap/1 ready"
FAILED = "rarms-bootstrap/1 failed"
FAILED_CODE = 90
STOP = b"s"
NO_MORE = b"o"
"""Said behind the scripts where the input ends at once and the script is to go on all the same."""

_PROGRAMS = {"pwsh": "pwsh", "powershell": "powershell.exe"}
_NAME = re.compile(r"[a-z0-9][a-z0-9.-]*\.ps1|Rarms/Rarms\.ps[dm]1")


def render_receiver() -> bytes:
    """What takes scripts from standard input and runs the first: its text travels ahead of them."""
    return as_script(read("bootstrap.ps1"))


def render_loader() -> bytes:
    """What ssh starts, as a reader sees it: it runs the receiver of exactly this version."""
    return fill("loader.ps1.j2", {"digest": hashlib.sha256(render_receiver()).hexdigest().upper()})


@cache
def command() -> str:
    """The loader without remarks and indentation: what the command holds, before it is encoded."""
    lines = [line.strip() for line in render_loader().decode("ascii").splitlines()]
    return "\n".join(line for line in lines if line and not line.startswith("#"))


def program_of(shell: str) -> str:
    """The program behind `connect.shell`."""
    return _PROGRAMS[shell]


def remote_words(shell: str) -> tuple[str, ...]:
    """The command that ssh starts at the other end; `-InputFormat None` leaves its standard input to the loader."""
    encoded = b64encode(command().encode("utf-16-le")).decode("ascii")
    options = ("-NoProfile", "-NonInteractive", "-InputFormat", "None", "-OutputFormat", "Text")
    return (program_of(shell), *options, "-EncodedCommand", encoded)


def arguments_of(script: str, waits: WaitLimits, *, abandoning: bool) -> tuple[str, ...]:
    """The arguments of a script that changes something; one out of an old journal may have no `-Force`."""
    force = ("-Force",) if "[switch] $Force" in script else ()
    lock = ("-LockTimeout", str(min(-(-waits.lock_ms // 1000), 999_999))) if waits.lock_ms > 0 else ()
    return ("-AsJson", *force, *lock, *(("-Abandon",) if abandoning else ()))


def frame(script: ScriptBundle, arguments: Sequence[str]) -> bytes:
    """The bytes for standard input: the receiver, then lengths and digests, then the scripts as they are.

    Raises:
        ValueError: a file has a name that the receiver would refuse.
    """
    names = [script.runs, *sorted(name for name in script.files if name != script.runs)]
    bodies = [script.files[name].encode("ascii") for name in names]
    for name in names:
        if not _NAME.fullmatch(name):
            raise ValueError(f"{name!r} cannot be a script's name")
    rows = [f"{name} {len(body)} {hashlib.sha256(body).hexdigest()}" for name, body in zip(names, bodies, strict=True)]
    table = "\n".join([" ".join(arguments), *rows]).encode("ascii")
    receiver = render_receiver()
    return b"".join([b"%08d" % len(receiver), receiver, b"%08d" % len(table), table, *bodies])
