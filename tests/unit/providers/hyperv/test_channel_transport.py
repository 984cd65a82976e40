"""Scripts on a Hyper-V host through a channel that runs one command."""

import sys
from dataclasses import dataclass, field
from pathlib import Path

import pytest

from rarms_iac.providers.channel import SSH_FAILED, CommandResult
from rarms_iac.providers.hyperv.bootstrap import FAILED, FAILED_CODE, NO_MORE, READY, RemotePowerShell
from rarms_iac.providers.hyperv.provider import open_hyperv
from rarms_iac.providers.hyperv.transport import RemoteTransport
from rarms_iac.providers.interface import HostFailed, ScriptBundle, ScriptExited, ScriptLost
from tests.builders import a_host

SCRIPT = ScriptBundle(runs="cell.ps1", files={"cell.ps1": "exit 0\r\n"})

THERE = RemotePowerShell("powershell")


@dataclass
class Answering:
    """A channel whose host gives one answer."""

    code: int
    output: str
    error: str = ""
    target: str = "ops@cell"
    asked: list[tuple[str, bytes]] = field(default_factory=list)

    def run(self, command: str, data: bytes, silence_s: float) -> CommandResult:
        self.asked.append((command, data))
        return CommandResult(code=self.code, output=self.output, error=self.error)


@dataclass
class Lines:
    """What a script said."""

    said: list[str] = field(default_factory=list)

    def line(self, text: str) -> None:
        self.said.append(text)

    def should_stop(self) -> bool:
        return False


def run(channel: Answering, listener: Lines) -> ScriptExited | ScriptLost:
    return RemoteTransport("onboard", channel, THERE).run(SCRIPT, ("-AsJson",), 5.0, listener)


def test_session_is_ssh_and_ends_its_input() -> None:
    channel, listener = Answering(3, f"a banner\n{READY}\none\ntwo\n", "a word\n"), Lines()

    assert run(channel, listener) == ScriptExited(code=3, last_lines=("a word",))
    assert listener.said == ["one", "two"]
    assert channel.asked == [(" ".join(THERE.words()), THERE.frame(SCRIPT, ("-AsJson",)) + NO_MORE)]


def test_a_host_without_that_powershell_is_named() -> None:
    with pytest.raises(HostFailed, match=r"powershell.exe does not start on ops@cell \(exit code 9009\): not found"):
        run(Answering(9009, "", "not found\n"), Lines())


def test_unsent_scripts_end_no_run() -> None:
    with pytest.raises(HostFailed, match="did not arrive as sent: bad name"):
        run(Answering(FAILED_CODE, f"{READY}\n{FAILED} bad name\n"), Lines())


def test_a_way_that_breaks_loses_the_script() -> None:
    ended = run(Answering(SSH_FAILED, f"{READY}\none\n", "Connection reset\n"), Lines())

    assert ended == ScriptLost(why="the connection broke (Connection reset)")


def test_nothing_is_talked_with() -> None:
    session = RemoteTransport("onboard", Answering(0, ""), THERE).session(SCRIPT, ())

    with pytest.raises(HostFailed, match="one command at a time"), session:
        pass


def test_channel_is_used_from_windows_too(monkeypatch: pytest.MonkeyPatch) -> None:
    """Without `connect` the host could be taken for this computer."""
    monkeypatch.setattr(sys, "platform", "win32")
    channel = Answering(9009, "", "not found\n")

    with pytest.raises(HostFailed, match="does not start on ops@cell"):
        open_hyperv(a_host("onboard"), Path("signed"), channel).observe()

    assert len(channel.asked) == 1
