"""What talks with a script on a Hyper-V host while it runs: its lines come, a request to stop and texts go.

Behind the bootstrap (`bootstrap`) a script is sent on a channel that was opened; which channel, `transport` knows.
"""

from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager, suppress
from typing import Protocol

from rarms_iac.model.commands import command, prose
from rarms_iac.model.host import Receiver
from rarms_iac.model.version import __version__
from rarms_iac.providers.channel import (
    SSH_FAILED,
    Channel,
    Conversation,
    SilenceTimeout,
    await_line,
    last_of,
    open_channel,
)
from rarms_iac.providers.hyperv.bootstrap import FAILED, FAILED_CODE, INSTALLED_FILE, STOP, RemotePowerShell
from rarms_iac.providers.interface import HostFailed, ScriptExited, ScriptLost

STOPPING_SECONDS = 120.0  # for a script to remove what it made


class Listener(Protocol):
    """Who runs a script: told each line, and asked whether to stop."""

    def line(self, text: str) -> None:
        """Take a line of the script's standard output."""

    def should_stop(self) -> bool:
        """Whether it should end before its next step."""


class ScriptSession(Protocol):
    """A script that runs, and is told things meanwhile."""

    def next_line(self, silence_s: float) -> str | None:
        """Return the next line of its standard output; None: it has ended.

        Raises:
            SilenceTimeout: nothing came for so long.
        """

    def send(self, line: str) -> None:
        """Have this text in the file beside the script that ends with `.next`; one without a dot asks it to stop."""

    def ended(self) -> ScriptExited | ScriptLost:
        """How it ended; waits for it for a while."""


def send_and_follow(
    channel: Conversation, host: str, frame: bytes, silence_s: float, listener: Listener
) -> ScriptExited | ScriptLost:
    """Send scripts to a bootstrap that is ready, and follow what the first of them says until it ends.

    Args:
        frame: the scripts, as of `RemotePowerShell.frame`.
        silence_s: seconds without a line after which it is taken for lost.
        listener: told each line, and asked whether to stop.

    Raises:
        HostFailed: the bootstrap would not run them.
    """
    channel.send(frame)
    refusal = RefusalListener(listener)
    return judge_end(host, follow(channel, silence_s, refusal, lambda: channel.send(STOP)), refusal)


def judge_end(host: str, ended: ScriptExited | ScriptLost, refusal: "RefusalListener") -> ScriptExited | ScriptLost:
    """How a script ended, or the bootstrap or the way to it before."""
    if isinstance(ended, ScriptExited) and ended.code == FAILED_CODE and refusal.reason:
        raise HostFailed(host, f"the scripts did not arrive as sent: {refusal.reason}", "Run it again.")
    if isinstance(ended, ScriptExited) and ended.code == SSH_FAILED:
        return ScriptLost(why=f"the connection broke ({last_of(ended.last_lines)})")
    return ended


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
def session_behind_bootstrap(channel: Conversation, frame: bytes) -> Iterator[_BootstrapSession]:
    """Run a script behind a bootstrap that is ready, until it has removed what it made."""
    channel.send(frame)
    try:
        yield _BootstrapSession(channel)
    finally:
        channel.send(STOP)
        with suppress(SilenceTimeout):
            while channel.next_line(STOPPING_SECONDS, lambda: None) is not None:
                continue


class RefusalListener:
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
def ready_channel(host: str, target: str, there: RemotePowerShell, words: Sequence[str]) -> Iterator[Channel]:
    """Start what ends in a bootstrap, and wait until that is ready.

    Raises:
        HostFailed: ssh does not get through, or PowerShell does not start.
    """
    with open_channel(host, words) as channel:
        await_bootstrap(channel, host, target, there)
        yield channel


def await_bootstrap(channel: Conversation, host: str, target: str, there: RemotePowerShell, way: str = "ssh") -> None:
    """Wait until the bootstrap at the other end is ready.

    Args:
        target: where it leads to, as messages name it.
        way: as `await_line` has it.

    Raises:
        HostFailed: the other end is not reached, PowerShell does not start there, or another module is installed.
    """
    line = await_line(channel, host, target, there.is_answer, way)
    if line is None:
        raise not_started(host, target, there, channel.code(), channel.error_lines)
    require_version(host, target, there, line)


def require_version(host: str, target: str, there: RemotePowerShell, line: str) -> None:
    """Raise where another version of the module answered than the one that made the scripts."""
    if found := there.other_versions(line):
        message = f"the module Rarms {__version__} is not installed on {target}, which has: {found}"
        raise HostFailed(host, message, _INSTALLING)


_INSTALLING = prose(
    "Have ",
    command("show", transport=True, out="FOLDER"),
    " write it, sign its files where only signed ones run, and copy FOLDER\\Rarms into "
    + INSTALLED_FILE.rpartition("\\Rarms\\")[0]
    + " there.",
)


def not_started(
    host: str, target: str, there: RemotePowerShell, code: int | None, error_lines: Sequence[str]
) -> HostFailed:
    """Return the error of a PowerShell that ended before its bootstrap was ready."""
    message = f"{there.program} does not start on {target} (exit code {code}): {last_of(error_lines)}"
    if there.receiver is Receiver.INSTALLED:
        message = f"the module Rarms does not answer on {target} (exit code {code}): {last_of(error_lines)}"
        return HostFailed(host, message, _INSTALLING)
    advice = "Say in the manifest which PowerShell the host has: `connect.shell: pwsh` or `powershell`."
    return HostFailed(host, message, advice)


def follow(
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
