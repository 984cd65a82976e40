"""Running scripts on a Hyper-V host: here through its PowerShell, elsewhere through ssh, or WinRM (`winrm`).

All are given the same bytes and say the same: lines, and an exit code. From elsewhere there is one fixed command, and
scripts on its standard input (`bootstrap`).
"""

import shutil
import sys
import tempfile
from collections.abc import Callable, Iterator, Sequence
from contextlib import AbstractContextManager, contextmanager, suppress
from pathlib import Path
from typing import Protocol

from rarms_iac.model.commands import command, prose
from rarms_iac.model.host import Connect
from rarms_iac.providers.channel import (
    SSH_FAILED,
    Channel,
    CommandChannel,
    Conversation,
    SilenceTimeout,
    await_line,
    last_of,
    one_command_only,
    open_channel,
    ssh_words,
)
from rarms_iac.providers.hyperv.bootstrap import (
    FAILED,
    FAILED_CODE,
    NO_MORE,
    READY,
    SHELLS,
    STOP,
    frame,
    program_of,
    remote_words,
)
from rarms_iac.providers.interface import HostFailed, ScriptBundle, ScriptExited, ScriptLost

STOPPING_SECONDS = 120.0  # for a script to remove what it made
OURS_ONLY = "D:P(A;OICI;FA;;;OW)(A;OICI;FA;;;BA)(A;OICI;FA;;;SY)"
"""Only the owner, Administrators and SYSTEM, at any place that `TEMP` names."""


class Listener(Protocol):
    """Who runs a script: told each line, and asked whether to stop."""

    def line(self, text: str) -> None:
        """A line of the script's standard output."""
        ...

    def should_stop(self) -> bool:
        """Whether it should end before its next step."""
        ...


class ScriptSession(Protocol):
    """A script that runs, and is told things meanwhile."""

    def next_line(self, silence_s: float) -> str | None:
        """The next line of its standard output; None: it has ended.

        Raises:
            SilenceTimeout: nothing came for so long.
        """
        ...

    def send(self, line: str) -> None:
        """Have this text in the file beside the script that ends with `.next`; one without a dot asks it to stop."""
        ...

    def ended(self) -> ScriptExited | ScriptLost:
        """How it ended; waits for it for a while."""
        ...


class Transport(Protocol):
    """A way to a host."""

    def session(self, script: ScriptBundle, arguments: Sequence[str]) -> AbstractContextManager[ScriptSession]:
        """Run these bytes there, and talk with them. When the context ends, or rarms dies, the script is asked to stop.

        Raises:
            HostFailed: there was no way to it; nothing was run.
        """
        ...

    def run(
        self, script: ScriptBundle, arguments: Sequence[str], silence_s: float, listener: Listener
    ) -> ScriptExited | ScriptLost:
        """Run these bytes there.

        Raises:
            HostFailed: there was no way to it; nothing was run.
        """
        ...


class LocalTransport:
    """The PowerShell of this computer."""

    def __init__(self, host: str) -> None:
        self._host = host

    def run(
        self, script: ScriptBundle, arguments: Sequence[str], silence_s: float, listener: Listener
    ) -> ScriptExited | ScriptLost:
        """The scripts lie in a folder of this user's own while they run."""
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
                return _follow(channel, silence_s, listener, stop.touch)

    @contextmanager
    def session(self, script: ScriptBundle, arguments: Sequence[str]) -> Iterator[ScriptSession]:
        """The bootstrap starts it here, too, since it notices when rarms is gone."""
        program = self._program()
        words = (program, *remote_words(SHELLS[0])[1:])
        with (
            _ready_channel(self._host, "this computer", program, words) as channel,
            _session(channel, script, arguments) as session,
        ):
            yield session

    def _program(self) -> str:
        for shell in SHELLS:
            if found := shutil.which(program_of(shell)):
                return found
        names = " or ".join(program_of(shell) for shell in SHELLS)
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


class SshTransport:
    """The system's ssh, which starts the fixed bootstrap at the other end."""

    def __init__(self, host: str, connect: Connect) -> None:
        self._host = host
        self._connect = connect

    def run(
        self, script: ScriptBundle, arguments: Sequence[str], silence_s: float, listener: Listener
    ) -> ScriptExited | ScriptLost:
        """Nothing is sent before the other end says that it is ready."""
        with self._ready() as channel:
            return send_and_follow(channel, self._host, script, arguments, silence_s, listener)

    @contextmanager
    def session(self, script: ScriptBundle, arguments: Sequence[str]) -> Iterator[ScriptSession]:
        with self._ready() as channel, _session(channel, script, arguments) as session:
            yield session

    def _ready(self) -> AbstractContextManager[Channel]:
        words = ssh_words(self._connect, remote_words(self._connect.shell))
        return _ready_channel(self._host, self._connect.ssh, program_of(self._connect.shell), words)


def send_and_follow(
    channel: Conversation,
    host: str,
    script: ScriptBundle,
    arguments: Sequence[str],
    silence_s: float,
    listener: Listener,
) -> ScriptExited | ScriptLost:
    """Send scripts to a bootstrap that is ready, and follow what the first of them says until it ends.

    Args:
        channel: to the bootstrap.
        host: its name in the manifest.
        script: the files.
        arguments: of the first.
        silence_s: seconds without a line after which it is taken for lost.
        listener: told each line, and asked whether to stop.

    Raises:
        HostFailed: the bootstrap would not run them.
    """
    channel.send(frame(script, arguments))
    refusal = _RefusalListener(listener)
    return _judged(host, _follow(channel, silence_s, refusal, lambda: channel.send(STOP)), refusal)


def _judged(host: str, ended: ScriptExited | ScriptLost, refusal: "_RefusalListener") -> ScriptExited | ScriptLost:
    """How a script ended, or the bootstrap or the way to it before."""
    if isinstance(ended, ScriptExited) and ended.code == FAILED_CODE and refusal.reason:
        raise HostFailed(host, f"the scripts did not arrive as sent: {refusal.reason}", "Run it again.")
    if isinstance(ended, ScriptExited) and ended.code == SSH_FAILED:
        return ScriptLost(why=f"the connection broke ({last_of(ended.last_lines)})")
    return ended


class ChannelTransport:
    """A channel that runs one command: lines are told when it has ended, and the script cannot be asked to stop."""

    def __init__(self, host: str, channel: CommandChannel, shell: str) -> None:
        self._host = host
        self._channel = channel
        self._shell = shell

    def run(
        self, script: ScriptBundle, arguments: Sequence[str], silence_s: float, listener: Listener
    ) -> ScriptExited | ScriptLost:
        command = " ".join(remote_words(self._shell))
        answer = self._channel.run(command, frame(script, arguments) + NO_MORE, silence_s)
        lines = answer.output.splitlines()
        errors = tuple(filter(None, map(str.strip, answer.error.splitlines())))
        if READY not in lines:
            raise _not_started(self._host, self._channel.target, program_of(self._shell), answer.code, errors)
        refusal = _RefusalListener(listener)
        for line in lines[lines.index(READY) + 1 :]:
            refusal.line(line)
        return _judged(self._host, ScriptExited(code=answer.code, last_lines=errors), refusal)

    def session(
        self,
        script: ScriptBundle,  # noqa: ARG002 - none can be run so
        arguments: Sequence[str],  # noqa: ARG002
    ) -> AbstractContextManager[ScriptSession]:
        raise one_command_only(self._host)


class _BootstrapSession:
    """A `ScriptSession` behind the bootstrap, which asks the script to stop when its input ends: rarms may be dead."""

    def __init__(self, channel: Conversation) -> None:
        self._channel = channel

    def next_line(self, silence_s: float) -> str | None:
        return self._channel.next_line(silence_s, lambda: None)

    def send(self, line: str) -> None:
        self._channel.send(line.encode("ascii"))

    def ended(self) -> ScriptExited | ScriptLost:
        code = self._channel.code()
        if code is None:
            return ScriptLost(why="it closed its output and did not end")
        return ScriptExited(code=code, last_lines=self._channel.error_lines)


@contextmanager
def _session(channel: Conversation, script: ScriptBundle, arguments: Sequence[str]) -> Iterator[_BootstrapSession]:
    """Run a script behind a bootstrap that is ready, until it has removed what it made."""
    channel.send(frame(script, arguments))
    try:
        yield _BootstrapSession(channel)
    finally:
        channel.send(STOP)
        with suppress(SilenceTimeout):
            while channel.next_line(STOPPING_SECONDS, lambda: None) is not None:
                continue


class _RefusalListener:
    """Passes lines on, and keeps why the bootstrap would not run the script."""

    def __init__(self, listener: Listener) -> None:
        self._listener = listener
        self.reason = ""

    def line(self, text: str) -> None:
        if text.startswith(FAILED):
            self.reason = text.removeprefix(FAILED).strip()
        else:
            self._listener.line(text)

    def should_stop(self) -> bool:
        return self._listener.should_stop()


@contextmanager
def _ready_channel(host: str, target: str, program: str, words: Sequence[str]) -> Iterator[Channel]:
    """Start what ends in a bootstrap, and wait until that is ready.

    Raises:
        HostFailed: ssh does not get through, or PowerShell does not start.
    """
    with open_channel(host, words) as channel:
        await_bootstrap(channel, host, target, program)
        yield channel


def await_bootstrap(channel: Conversation, host: str, target: str, program: str, way: str = "ssh") -> None:
    """Wait until the bootstrap at the other end is ready.

    Args:
        channel: to what starts it.
        host: its name in the manifest.
        target: where it leads to, as messages name it.
        program: the PowerShell that is started there.
        way: as `await_line` has it.

    Raises:
        HostFailed: the other end is not reached, or PowerShell does not start there.
    """
    if await_line(channel, host, target, lambda line: line == READY, way) is None:
        raise _not_started(host, target, program, channel.code(), channel.error_lines)


def _not_started(host: str, target: str, program: str, code: int | None, error_lines: Sequence[str]) -> HostFailed:
    return HostFailed(
        host,
        f"{program} does not start on {target} (exit code {code}): {last_of(error_lines)}",
        "Say in the manifest which PowerShell the host has: `connect.shell: pwsh` or `powershell`.",
    )


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


def _follow(
    channel: Conversation, silence_s: float, listener: Listener, stop: Callable[[], None]
) -> ScriptExited | ScriptLost:
    """Pass every line on until the end, and a request to stop the other way, once."""
    asked = False

    def look() -> None:
        nonlocal asked
        if not asked and listener.should_stop():
            asked = True
            stop()

    try:
        while (line := channel.next_line(silence_s, look)) is not None:
            listener.line(line)
    except SilenceTimeout:
        return ScriptLost(why=f"it said nothing for {silence_s:.0f} s")
    code = channel.code()
    if code is None:
        return ScriptLost(why="it closed its output and did not end")
    return ScriptExited(code=code, last_lines=channel.error_lines)
