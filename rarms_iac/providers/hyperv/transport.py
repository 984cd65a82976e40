"""Running scripts on a Hyper-V host: here through its PowerShell, elsewhere through ssh, or WinRM (`winrm`).

All are given the same bytes and say the same: lines, and an exit code. From elsewhere there is one fixed command, and
scripts on its standard input (`bootstrap`).
"""

import shutil
import tempfile
from collections.abc import Iterator, Sequence
from contextlib import AbstractContextManager, contextmanager
from dataclasses import replace
from pathlib import Path
from typing import Protocol

from rarms_iac.model.commands import command, prose
from rarms_iac.model.host import Connect
from rarms_iac.providers.channel import Channel, CommandChannel, one_command_only, open_channel, ssh_words
from rarms_iac.providers.hyperv.bootstrap import NO_MORE, SHELLS, WINDOWS_POWERSHELL, RemotePowerShell, program_of
from rarms_iac.providers.hyperv.file_access import OURS_ONLY, protect
from rarms_iac.providers.hyperv.script_session import (
    Listener,
    RefusalListener,
    ScriptSession,
    follow,
    judge_end,
    not_started,
    ready_channel,
    require_version,
    send_and_follow,
    session_behind_bootstrap,
)
from rarms_iac.providers.interface import HostFailed, ScriptBundle, ScriptExited, ScriptLost


class Transport(Protocol):
    """A way to a host."""

    def session(self, script: ScriptBundle, arguments: Sequence[str]) -> AbstractContextManager[ScriptSession]:
        """Run these bytes there, and talk with them. When the context ends, or rarms dies, the script is asked to stop.

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
        """Return the scripts lie in a folder of this user's own while they run."""
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
                return follow(channel, silence_s, listener, stop.touch)

    @contextmanager
    def session(self, script: ScriptBundle, arguments: Sequence[str]) -> Iterator[ScriptSession]:
        """Yield the bootstrap starts it here, too, since it notices when rarms is gone."""
        program = self._program()
        there = RemotePowerShell(self._shells[-1])
        with (
            ready_channel(self._host, "this computer", there, (program, *there.words()[1:])) as channel,
            session_behind_bootstrap(channel, there.frame(script, arguments)) as session,
        ):
            yield session

    def in_windows_powershell(self) -> "LocalTransport":
        return LocalTransport(self._host, (WINDOWS_POWERSHELL,))

    def _program(self) -> str:
        for shell in self._shells:
            if found := shutil.which(program_of(shell)):
                return found
        names = " or ".join(map(program_of, self._shells))
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
        self._there = RemotePowerShell(connect.shell, connect.receiver)

    def run(
        self, script: ScriptBundle, arguments: Sequence[str], silence_s: float, listener: Listener
    ) -> ScriptExited | ScriptLost:
        """Nothing is sent before the other end says that it is ready."""
        with self._ready() as channel:
            return send_and_follow(channel, self._host, self._there.frame(script, arguments), silence_s, listener)

    @contextmanager
    def session(self, script: ScriptBundle, arguments: Sequence[str]) -> Iterator[ScriptSession]:
        with (
            self._ready() as channel,
            session_behind_bootstrap(channel, self._there.frame(script, arguments)) as session,
        ):
            yield session

    def in_windows_powershell(self) -> "SshTransport":
        return SshTransport(self._host, replace(self._connect, shell=WINDOWS_POWERSHELL))

    def _ready(self) -> AbstractContextManager[Channel]:
        words = ssh_words(self._connect, self._there.words())
        return ready_channel(self._host, self._connect.ssh, self._there, words)


class ChannelTransport:
    """A channel that runs one command: lines are told when it has ended, and the script cannot be asked to stop."""

    def __init__(self, host: str, channel: CommandChannel, there: RemotePowerShell) -> None:
        self._host = host
        self._channel = channel
        self._there = there

    def run(
        self, script: ScriptBundle, arguments: Sequence[str], silence_s: float, listener: Listener
    ) -> ScriptExited | ScriptLost:
        command = " ".join(self._there.words())
        answer = self._channel.run(command, self._there.frame(script, arguments) + NO_MORE, silence_s)
        lines = answer.output.splitlines()
        errors = tuple(filter(None, map(str.strip, answer.error.splitlines())))
        ready = next((at for at, line in enumerate(lines) if self._there.is_answer(line)), None)
        if ready is None:
            raise not_started(self._host, self._channel.target, self._there, answer.code, errors)
        require_version(self._host, self._channel.target, self._there, lines[ready])
        refusal = RefusalListener(listener)
        for line in lines[ready + 1 :]:
            refusal.line(line)
        return judge_end(self._host, ScriptExited(code=answer.code, last_lines=errors), refusal)

    def session(
        self,
        script: ScriptBundle,  # noqa: ARG002 - none can be run so
        arguments: Sequence[str],  # noqa: ARG002
    ) -> AbstractContextManager[ScriptSession]:
        raise one_command_only(self._host)

    def in_windows_powershell(self) -> "ChannelTransport":
        return ChannelTransport(self._host, self._channel, replace(self._there, shell=WINDOWS_POWERSHELL))
