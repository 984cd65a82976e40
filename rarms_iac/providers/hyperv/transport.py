"""Running scripts on a Hyper-V host, and talking with them: here through its PowerShell, elsewhere through a channel.

All are given the same bytes and say the same: lines, and an exit code. From elsewhere there is one fixed command, and
scripts on its standard input (`bootstrap`).
"""

import shutil
import sys
import tempfile
from collections.abc import Callable, Iterator, Sequence
from contextlib import AbstractContextManager, contextmanager, suppress
from dataclasses import replace
from pathlib import Path
from typing import Protocol

from rarms_iac.model.commands import command, prose
from rarms_iac.model.host import Receiver
from rarms_iac.model.version import __version__
from rarms_iac.providers.channel import (
    SSH_FAILED,
    CommandChannel,
    Conversation,
    EndedConversation,
    LiveChannel,
    ProgramChannel,
    SilenceTimeout,
    await_line,
    last_of,
    look_for_stop,
    no_look,
    one_command_only,
    open_channel,
)
from rarms_iac.providers.hyperv.bootstrap import (
    FAILED,
    FAILED_CODE,
    INSTALLED_FILE,
    NO_MORE,
    PROGRAMS,
    SHELLS,
    STOP,
    WINDOWS_POWERSHELL,
    RemotePowerShell,
)
from rarms_iac.providers.interface import HostFailed, ScriptBundle, ScriptExited, ScriptLost

STOPPING_SECONDS = 120.0  # for a script to remove what it made

ADMINISTRATORS_ONLY = "O:BAG:SYD:P(A;OICI;FA;;;BA)(A;OICI;FA;;;SY)"
"""As `templates/powershell/Rarms/Rarms.psm1` has it."""

OURS_ONLY = "D:P(A;OICI;FA;;;OW)(A;OICI;FA;;;BA)(A;OICI;FA;;;SY)"
"""Only the owner, Administrators and SYSTEM, at any place that `TEMP` names."""

_INSTALLING = prose(
    "Have ",
    command("show", transport=True, out="FOLDER"),
    " write it, sign its files where only signed ones run, and copy FOLDER\\Rarms into "
    + INSTALLED_FILE.rpartition("\\Rarms\\")[0]
    + " there.",
)


class Listener(Protocol):
    """Who runs a script: told each line, and asked whether to stop."""

    def line(self, text: str) -> None:
        """Take a line of the script's standard output."""

    def should_stop(self) -> bool:
        """Whether it should end before its next step."""


class Transport(Protocol):
    """A way to a host."""

    def session(self, script: ScriptBundle, arguments: Sequence[str]) -> AbstractContextManager[Conversation]:
        """Run these bytes there, and talk with them. When the context ends, or rarms dies, the script is asked to stop.

        What is sent becomes the file beside the script that ends with `.next`; a text without a dot asks it to stop.

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


class LocalTransport:
    """The PowerShell of this computer."""

    def __init__(self, host: str, shells: Sequence[str] = SHELLS) -> None:
        self._host = host
        self._shells = shells

    def run(
        self, script: ScriptBundle, arguments: Sequence[str], silence_s: float, listener: Listener
    ) -> ScriptExited | ScriptLost:
        """Have the scripts in a folder of this user's own while they run."""
        program = self._program()
        with tempfile.TemporaryDirectory(prefix="rarms-") as folder:
            protect(folder, OURS_ONLY)
            for name, text in script.files.items():
                file = Path(folder) / name
                file.parent.mkdir(exist_ok=True)
                file.write_bytes(text.encode("ascii"))
            path = Path(folder) / script.runs
            options = ("-NoProfile", "-NonInteractive", "-ExecutionPolicy", "RemoteSigned", "-File", str(path))
            stop = path.with_name(f"{path.name}.stop")
            with open_channel(self._host, (program, *options, *arguments)) as channel:
                channel.close()
                return follow(channel, self._host, silence_s, listener, stop.touch)

    @contextmanager
    def session(self, script: ScriptBundle, arguments: Sequence[str]) -> Iterator[Conversation]:
        """Have the bootstrap start it here, too, since it notices when rarms is gone."""
        there = RemotePowerShell(self._shells[-1])
        here = ProgramChannel(host=self._host, target="this computer", words=())
        with open_channel(self._host, (self._program(), *there.words()[1:])) as channel:
            _await_bootstrap(channel, self._host, here, there)
            with _until_stopped(channel, there.frame(script, arguments)):
                yield channel

    def in_windows_powershell(self) -> "LocalTransport":
        return LocalTransport(self._host, (WINDOWS_POWERSHELL,))

    def _program(self) -> str:
        for shell in self._shells:
            if found := shutil.which(PROGRAMS[shell]):
                return found
        names = " or ".join(PROGRAMS[shell] for shell in self._shells)
        raise HostFailed(
            self._host,
            f"{names} is not on this computer, which the manifest says is the host",
            prose(
                "Say how the host is reached (`connect: {ssh: user@host}`), or plan without it: run the script that ",
                command("snapshot", script=True),
                " writes there, then ",
                command("plan", snapshot=f"{self._host}=FILE"),
                ".",
            ),
        )


class RemoteTransport:
    """A channel that starts the fixed bootstrap at the other end.

    Nothing is sent before the other end says that it is ready. A channel that runs one command sends all at once: lines
    are told when it has ended, and the script cannot be asked to stop.
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
        with self._channel.open(self._command) as conversation:
            _await_bootstrap(conversation, self._host, self._channel, self._there)
            with _until_stopped(conversation, self._there.frame(script, arguments)):
                yield conversation

    def in_windows_powershell(self) -> "RemoteTransport":
        return RemoteTransport(self._host, self._channel, replace(self._there, shell=WINDOWS_POWERSHELL))


@contextmanager
def _until_stopped(conversation: Conversation, frame: bytes) -> Iterator[None]:
    """Run a script behind a bootstrap that is ready, until it has removed what it made."""
    conversation.send(frame)
    try:
        yield
    finally:
        conversation.send(STOP)
        with suppress(SilenceTimeout):
            while conversation.next_line(STOPPING_SECONDS, no_look) is not None:
                continue


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
    advice = "Say in the manifest which PowerShell the host has: `connect.shell: pwsh` or `powershell`."
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
        return ScriptLost(why=f"it said nothing for {silence_s:.0f} s")
    ended = end_of(conversation)
    if refusal and isinstance(ended, ScriptExited) and ended.code == FAILED_CODE:
        raise HostFailed(host, f"the scripts did not arrive as sent: {refusal}", "Run it again.")
    return ended


def end_of(conversation: Conversation) -> ScriptExited | ScriptLost:
    """Return how a script ended that has no more lines."""
    code = conversation.code()
    if code is None:
        return ScriptLost(why="it closed its output and did not end")
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
