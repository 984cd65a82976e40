"""Running scripts on a Hyper-V host, this computer or another one, and talking with them.

Each channel starts one fixed command; all else comes to its standard input: scripts in a frame with lengths and
digests. `templates/powershell/loader.ps1.j2` and the module's `Receive-RarmsPlan` say how that is read there. The
command's words are plain ASCII without spaces or quotes, so that it means the same to cmd.exe, PowerShell and every
other shell that sshd may start.
"""

import hashlib
import re
import shutil
import sys
import tempfile
import time
from base64 import b64encode
from collections.abc import Callable, Iterator, Sequence
from contextlib import AbstractContextManager, contextmanager, suppress
from dataclasses import dataclass, replace
from functools import cache
from pathlib import Path
from typing import Protocol

from rarms_iac.model import commands
from rarms_iac.model.commands import prose
from rarms_iac.model.host import Receiver, Shell
from rarms_iac.model.version import __version__
from rarms_iac.powershell.templates import as_script, fill, receiver_text, template_text
from rarms_iac.providers.channel import (
    SSH_FAILED,
    Channel,
    CommandChannel,
    Conversation,
    EndedConversation,
    LiveChannel,
    SilenceTimeout,
    await_line,
    last_of,
    look_for_stop,
    no_look,
    one_command_only,
    open_channel,
)
from rarms_iac.providers.interface import HostFailed, ScriptBundle, ScriptExited, ScriptLost, WaitLimits

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
    """Return the script that takes others from standard input and runs the first: its text travels ahead of them."""
    return fill("bootstrap.ps1.j2", {"receiver": receiver_text()})


def render_loader() -> bytes:
    """Return the short script that ssh starts, for a reader: it runs the receiver of exactly this version."""
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
    """The program at the other end: a PowerShell, and in it the receiver of scripts from standard input."""

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
        """Return whether the line says that scripts can come, or why not."""
        return line == READY if self.receiver is Receiver.SENT else line.startswith(ANSWERS)

    def other_versions(self, line: str) -> str:
        """Return the versions of the module that are there instead of this one; empty if it is ready."""
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


OURS_ONLY = "D:P(A;OICI;FA;;;OW)(A;OICI;FA;;;BA)(A;OICI;FA;;;SY)"
"""Only the owner, Administrators and SYSTEM, at any place that `TEMP` names."""

STOPPING_SECONDS = 120.0  # for a script to remove what it made

_INSTALLING = prose(
    "Have ",
    commands.command("show", transport=True, out="FOLDER"),
    " write it, sign its files if the host runs only signed scripts, and copy FOLDER\\Rarms to "
    + INSTALLED_FILE.rpartition("\\Rarms\\")[0]
    + " there.",
)


class Listener(Protocol):
    """The caller of a script's run: it gets each line, and is asked for a stop."""

    def line(self, text: str) -> None:
        """Take a line of the script's standard output."""

    def should_stop(self) -> bool:
        """Return whether the script should end before its next step."""


class Transport(Protocol):
    """A way to a host."""

    def session(self, script: ScriptBundle, arguments: Sequence[str]) -> AbstractContextManager[Conversation]:
        """Run these bytes there, and talk with them. When the context ends, or rarms dies, the script is asked to stop.

        What is sent becomes the file next to the script that ends with `.next`; a text without a dot asks it to stop.

        Raises:
            HostFailed: there was no way to it; nothing was run.
        """

    def run(
        self, script: ScriptBundle, arguments: Sequence[str], silence_s: float, listener: Listener
    ) -> ScriptExited | ScriptLost:
        """Run these bytes there.

        Raises:
            HostFailed: there was no way to it; nothing was run.
        """

    def in_windows_powershell(self) -> "Transport":
        """Make a transport to this host that starts Windows PowerShell 5.1 there."""


class ScriptTransport:
    """A channel that starts the fixed bootstrap at the other end.

    Nothing is sent before the other end says that it is ready. A channel that runs one command sends all at once: lines
    arrive when it has ended, and the script cannot be asked to stop.
    """

    def __init__(self, host: str, channel: CommandChannel, there: RemotePowerShell) -> None:
        self._host = host
        self._channel = channel
        self._there = there
        self._command = " ".join(there.words())

    def run(
        self, script: ScriptBundle, arguments: Sequence[str], silence_s: float, listener: Listener
    ) -> ScriptExited | ScriptLost:
        frame = self._there.frame(script, arguments)
        with self._ready(frame, silence_s) as conversation:
            ended = follow(conversation, self._host, silence_s, listener, lambda: conversation.send(STOP))
        if isinstance(ended, ScriptExited) and ended.code == SSH_FAILED:
            return ScriptLost(why=f"the connection broke ({last_of(ended.last_lines)})")
        return ended

    @contextmanager
    def _ready(self, frame: bytes, silence_s: float) -> Iterator[Conversation]:
        """Yield a conversation with a bootstrap that was ready, and has the scripts now."""
        if isinstance(self._channel, LiveChannel):
            with self._channel.open(self._command) as conversation:
                _await_bootstrap(conversation, self._host, self._channel, self._there)
                conversation.send(frame)
                yield conversation
        else:
            ended = EndedConversation(self._channel.run(self._command, frame + NO_MORE, silence_s))
            _await_bootstrap(ended, self._host, self._channel, self._there)
            yield ended

    @contextmanager
    def session(self, script: ScriptBundle, arguments: Sequence[str]) -> Iterator[Conversation]:
        if not isinstance(self._channel, LiveChannel):
            raise one_command_only(self._host)
        if refusal := self._channel.refusal_to_measure:
            raise refusal
        with self._ready(self._there.frame(script, arguments), 0.0) as conversation:
            try:
                yield conversation
            finally:  # it removes what it made
                conversation.send(STOP)
                until = time.monotonic() + STOPPING_SECONDS  # one that nobody can stop may say something for ever
                with suppress(SilenceTimeout):
                    while conversation.next_line(max(0.0, until - time.monotonic()), no_look) is not None:
                        if time.monotonic() > until:
                            break

    def in_windows_powershell(self) -> "ScriptTransport":
        return ScriptTransport(self._host, self._channel, replace(self._there, shell=WINDOWS_POWERSHELL))


@dataclass(frozen=True, slots=True, kw_only=True)
class LocalChannel(LiveChannel):
    """The PowerShell of this computer."""

    target: str = "this computer"

    def open(self, command: str) -> Channel:
        return self.start(*command.split(" "))

    def start(self, program: str, *options: str) -> Channel:
        """Start a PowerShell.

        Raises:
            HostFailed: it is not here.
        """
        if found := shutil.which(program):
            return open_channel(self.host, (found, *options))
        raise HostFailed(
            self.host,
            f"{' or '.join(PROGRAMS.values())} is not on this computer, which is the host in the manifest",
            prose(
                "Write the connection to the host into the manifest: `connect: {ssh: user@host}`. A plan also works "
                "without a connection: write a script with ",
                commands.command("snapshot", script=True),
                ", run it on the host, then ",
                commands.command("plan", snapshot=f"{self.host}=FILE"),
                ".",
            ),
        )


class LocalTransport(ScriptTransport):
    """The PowerShell of this computer.

    It runs scripts as files: where a policy forbids the bootstrap's text, signed files may run. The bootstrap starts
    only what is talked with, since it notices when rarms is gone.
    """

    def __init__(self, host: str, shell: str = "") -> None:
        self._here = LocalChannel(host=host)
        found = next((each for each in SHELLS if shutil.which(PROGRAMS[each])), WINDOWS_POWERSHELL)
        super().__init__(host, self._here, RemotePowerShell(shell or found))

    def run(
        self, script: ScriptBundle, arguments: Sequence[str], silence_s: float, listener: Listener
    ) -> ScriptExited | ScriptLost:
        """Have the scripts in a folder of this user's own while they run."""
        with tempfile.TemporaryDirectory(prefix="rarms-") as folder:
            protect(folder, OURS_ONLY)
            for name, text in script.files.items():
                file = Path(folder) / name
                file.parent.mkdir(exist_ok=True)
                file.write_bytes(text.encode("ascii"))
            path = Path(folder) / script.runs
            options = ("-NoProfile", "-NonInteractive", "-ExecutionPolicy", "RemoteSigned", "-File", str(path))
            stop = path.with_name(f"{path.name}.stop")
            with self._here.start(self._there.program, *options, *arguments) as channel:
                channel.close()
                return follow(channel, self._host, silence_s, listener, stop.touch)

    def in_windows_powershell(self) -> "LocalTransport":
        return LocalTransport(self._host, WINDOWS_POWERSHELL)


def _await_bootstrap(conversation: Conversation, host: str, channel: CommandChannel, there: RemotePowerShell) -> None:
    """Wait until the bootstrap at the other end is ready.

    Raises:
        HostFailed: the other end is not reached, PowerShell does not start there, or another module is installed.
    """
    target, line = channel.target, await_line(conversation, host, channel, there.is_answer)
    if line is not None:
        if found := there.other_versions(line):
            message = f"the module Rarms {__version__} is not installed on {target}, which has: {found}"
            raise HostFailed(host, message, _INSTALLING)
        return
    end = f"on {target} (exit code {conversation.code()}): {last_of(conversation.error_lines)}"
    if there.receiver is Receiver.INSTALLED:
        raise HostFailed(host, f"the module Rarms does not answer {end}", _INSTALLING)
    advice = "Set the PowerShell of the host in the manifest: `connect.shell: pwsh` or `powershell`."
    raise HostFailed(host, f"{there.program} does not start {end}", advice)


def follow(
    conversation: Conversation, host: str, silence_s: float, listener: Listener, stop: Callable[[], None]
) -> ScriptExited | ScriptLost:
    """Pass every line on until the end, and a request to stop the other way, once.

    Raises:
        HostFailed: the bootstrap would not run the scripts.
    """
    refusal, look = "", look_for_stop(listener.should_stop, stop)
    try:
        while (line := conversation.next_line(silence_s, look)) is not None:
            if line.startswith(FAILED):
                refusal = line.removeprefix(FAILED).strip()
            else:
                listener.line(line)
    except SilenceTimeout:
        return ScriptLost(why=f"no output for {silence_s:.0f} s")
    ended = end_of(conversation)
    if refusal and isinstance(ended, ScriptExited) and ended.code == FAILED_CODE:
        raise HostFailed(host, f"the host received damaged scripts: {refusal}", "Run the same command again.")
    return ended


def end_of(conversation: Conversation) -> ScriptExited | ScriptLost:
    """Return the ending of a script that has no more lines."""
    code = conversation.code()
    if code is None:
        return ScriptLost(why="it closed its output but did not end")
    return ScriptExited(code=code, last_lines=conversation.error_lines)


def protect(path: str, descriptor: str) -> None:
    """Give a file or folder this owner and access list, and no inherited ones; Linux has other means.

    Args:
        path: of what is there already.
        descriptor: as SDDL; without `O:` its owner stays.
    """
    if sys.platform == "win32":
        import win32security

        wanted = win32security.ConvertStringSecurityDescriptorToSecurityDescriptor(
            descriptor, win32security.SDDL_REVISION_1
        )
        owner, flags = wanted.GetSecurityDescriptorOwner(), win32security.DACL_SECURITY_INFORMATION
        flags |= win32security.PROTECTED_DACL_SECURITY_INFORMATION
        flags |= win32security.OWNER_SECURITY_INFORMATION if owner else 0
        access = wanted.GetSecurityDescriptorDacl()
        win32security.SetNamedSecurityInfo(path, win32security.SE_FILE_OBJECT, flags, owner, None, access, None)
