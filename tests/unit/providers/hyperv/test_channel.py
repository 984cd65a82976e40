"""A program that was started: its events, and nothing of it lives on."""

import hashlib
import json
import re
import sys
from base64 import b64decode
from dataclasses import dataclass, field
from pathlib import Path

import pytest

from rarms_iac.model.host import Connect, Receiver
from rarms_iac.model.version import __version__
from rarms_iac.providers.channel import SSH_FAILED, Channel, CommandResult, ProgramChannel, as_text, ssh_words
from rarms_iac.providers.hyperv.provider import open_hyperv, read_event
from rarms_iac.providers.hyperv.transport import (
    FAILED,
    FAILED_CODE,
    NO_MORE,
    OURS_ONLY,
    READY,
    RemotePowerShell,
    ScriptTransport,
    arguments_of,
    command,
    protect,
    render_loader,
    render_receiver,
)
from rarms_iac.providers.interface import (
    EventKind,
    EventStatus,
    HostFailed,
    RunEvent,
    ScriptBundle,
    ScriptExited,
    ScriptLost,
    WaitLimits,
)
from tests.builders import a_host
from tests.powershell_lint.tree import parse, text_of, walk

EVENT = {
    "format": "rarms-event/1",
    "kind": "step",
    "plan": "0123456789ab",
    "number": 2,
    "total": 5,
    "address": "partition/vision",
    "status": "changed",
    "detail": "reserve 40 %",
}


def test_a_line_of_a_script_is_an_event() -> None:
    assert read_event(json.dumps(EVENT)) == RunEvent(
        kind=EventKind.STEP,
        plan="0123456789ab",
        number=2,
        total=5,
        address="partition/vision",
        status=EventStatus.CHANGED,
        detail="reserve 40 %",
    )


@pytest.mark.parametrize(
    "line",
    [
        "",
        "WARNING: the module was loaded twice",
        "{",
        "[]",
        json.dumps({**EVENT, "format": "rarms-event/2"}),
        json.dumps({**EVENT, "status": "exploded"}),
        json.dumps({**EVENT, "kind": "party"}),
        json.dumps({**EVENT, "number": "2"}),
        json.dumps({**EVENT, "number": -1}),
        json.dumps({**EVENT, "number": 6}),
        json.dumps({**EVENT, "number": True}),
        json.dumps({**EVENT, "more": 1}),
        json.dumps({name: value for name, value in EVENT.items() if name != "detail"}),
        json.dumps(EVENT)[:-1] + ',"detail":"twice"}',
        '{"a":' * 5000,
        json.dumps({**EVENT, "detail": "x" * 200_000}),
        json.dumps(EVENT) + " trailing",
    ],
)
def test_any_other_line_is_none(line: str) -> None:
    assert read_event(line) is None


@pytest.mark.parametrize(
    ("line", "text"),
    [("Zähler".encode(), "Zähler"), (b"Z\x84hler", "Zähler")],
    ids=["UTF-8", "code page"],
)
@pytest.mark.needs("posix")  # on Windows the code page is the computer's own
def test_foreign_line_comes_in_code_page(line: bytes, text: str) -> None:
    assert as_text(line) == text


PARENT = """
import subprocess, sys
subprocess.Popen([sys.executable, "-c", "import time; time.sleep(600)"], stdout=sys.stdout, stderr=sys.stderr)
print("on", flush=True)
import time; time.sleep(600)
"""


def test_what_a_program_started_ends_with_the_channel() -> None:
    """As long as it lives it holds the pipes, and the channel would wait for their end."""
    with Channel((sys.executable, "-c", PARENT)) as channel:
        assert channel.next_line(60, lambda: None) == "on"


def test_program_that_has_ended_has_no_more_lines() -> None:
    """Who stops a session asks again: it would wait until it takes the program for silent."""
    with Channel((sys.executable, "-c", "print('on')")) as channel:
        lines = [channel.next_line(60, lambda: None), *(channel.next_line(1, lambda: None) for _ in range(2))]

    assert lines == ["on", None, None]


KEEPS_PIPES = """
import sys, time
from pathlib import Path
end, given_up = map(Path, sys.argv[1:])
for _ in range(1200):
    if end.exists():
        sys.exit()
    time.sleep(0.05)
given_up.touch()
"""
HANDED_ON = """
import subprocess, sys
subprocess.Popen([sys.executable, "-c", *sys.argv[1:]], stdout=sys.stdout, stderr=sys.stderr)
print("on", flush=True)
"""


def test_channel_ends_despite_inherited_pipes(tmp_path: Path) -> None:
    """As a connection that ssh keeps for later calls may do."""
    end, given_up = tmp_path / "end", tmp_path / "given up"
    with Channel((sys.executable, "-c", HANDED_ON, KEEPS_PIPES, str(end), str(given_up))) as channel:
        assert channel.next_line(60, lambda: None) == "on"
        assert channel.code() == 0

    assert not given_up.exists()
    end.touch()


@pytest.mark.needs("windows")
def test_script_folder_is_private_on_windows(tmp_path: Path) -> None:
    """Wine keeps what its Linux can say, the owner's rights and everybody's: that Administrators stay is not seen."""
    import win32security

    def trusted() -> set[str]:
        descriptor = win32security.GetNamedSecurityInfo(
            str(tmp_path), win32security.SE_FILE_OBJECT, win32security.DACL_SECURITY_INFORMATION
        )
        found = descriptor.GetSecurityDescriptorDacl()
        return {win32security.ConvertSidToStringSid(found.GetAce(at)[2]) for at in range(found.GetAceCount())}

    everybody = win32security.ConvertStringSecurityDescriptorToSecurityDescriptor("D:(A;OICI;FA;;;WD)", 1)
    win32security.SetFileSecurity(str(tmp_path), win32security.DACL_SECURITY_INFORMATION, everybody)
    assert "S-1-1-0" in trusted()

    protect(str(tmp_path), OURS_ONLY)

    assert "S-1-1-0" not in trusted()
    (tmp_path / "plan.ps1").touch()


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
    return ScriptTransport("onboard", channel, THERE).run(SCRIPT, ("-AsJson",), 5.0, listener)


def test_session_is_ssh_and_ends_its_input() -> None:
    channel, listener = Answering(3, f"a banner\n{READY}\none\ntwo\n", "a word\n"), Lines()

    assert run(channel, listener) == ScriptExited(code=3, last_lines=("a word",))
    assert listener.said == ["one", "two"]
    assert channel.asked == [(" ".join(THERE.words()), THERE.frame(SCRIPT, ("-AsJson",)) + NO_MORE)]


def test_a_host_without_that_powershell_is_named() -> None:
    with pytest.raises(HostFailed, match=r"powershell.exe does not start on ops@cell \(exit code 9009\): not found"):
        run(Answering(9009, "", "not found\n"), Lines())


def test_unsent_scripts_end_no_run() -> None:
    with pytest.raises(HostFailed, match="received damaged scripts: bad name"):
        run(Answering(FAILED_CODE, f"{READY}\n{FAILED} bad name\n"), Lines())


def test_a_way_that_breaks_loses_the_script() -> None:
    ended = run(Answering(SSH_FAILED, f"{READY}\none\n", "Connection reset\n"), Lines())

    assert ended == ScriptLost(why="the connection broke (Connection reset)")


@pytest.mark.needs("posix")
def test_killed_ssh_is_a_way_that_broke() -> None:
    way = ProgramChannel(host="onboard", target="ops@cell", words=("sh", "-c"))

    assert way.run("kill -9 $$", b"", 60.0).code == SSH_FAILED


def test_nothing_is_talked_with() -> None:
    session = ScriptTransport("onboard", Answering(0, ""), THERE).session(SCRIPT, ())

    with pytest.raises(HostFailed, match="one command at a time"), session:
        pass


def test_channel_is_used_from_windows_too(monkeypatch: pytest.MonkeyPatch) -> None:
    """Without `connect` the host could be taken for this computer."""
    monkeypatch.setattr(sys, "platform", "win32")
    channel = Answering(9009, "", "not found\n")

    with pytest.raises(HostFailed, match="does not start on ops@cell"):
        open_hyperv(a_host("onboard"), Path("signed"), channel).observe()

    assert len(channel.asked) == 1


BUNDLE = ScriptBundle(runs="cell.ps1", files={"cell.undo.ps1": "undo\r\n", "cell.ps1": "do\r\n"})

LONGEST_COMMAND = 8191
"""Characters of a command line that cmd.exe takes, which Windows' sshd starts by default."""
LONGEST_LOADER = 4000


def test_what_travels_is_same_without_remarks_and_indentation() -> None:
    def leaves(text: str) -> list[str]:
        return [text_of(node) for node in walk(parse(text)) if node.child_count == 0 and node.type != "comment"]

    assert leaves(command()) == leaves(render_loader().decode("ascii"))


def test_loader_runs_no_other_receiver_than_this_one() -> None:
    assert f"'{hashlib.sha256(render_receiver()).hexdigest().upper()}'" in command()
    assert len(render_receiver()) <= 65536


@pytest.mark.parametrize("shell", ["pwsh", "powershell"])
def test_command_fits_and_means_same_to_every_shell(shell: str) -> None:
    words = RemotePowerShell(shell).words()

    assert len(f'cmd.exe /c "{" ".join(words)}"') < LONGEST_COMMAND
    assert len(words[-1]) < LONGEST_LOADER
    assert all(re.fullmatch(r"[A-Za-z0-9.+/=-]+", word) for word in words)
    assert b64decode(words[-1]).decode("utf-16-le") == command()


@pytest.mark.parametrize(
    ("line", "answers", "other"),
    [
        (f"rarms-receiver/1 ready {__version__}", True, ""),
        ("rarms-receiver/1 ready 0.0.9", True, "0.0.9"),
        ("rarms-receiver/1 has 0.0.8 0.0.9", True, "0.0.8 0.0.9"),
        ("rarms-receiver/1 has ", True, "none"),
        ("rarms-bootstrap/1 ready", False, ""),
        ("a banner", False, ""),
    ],
)
def test_an_installed_module_of_another_version_is_named(line: str, answers: bool, other: str) -> None:
    there = RemotePowerShell("powershell", Receiver.INSTALLED)

    assert there.is_answer(line) is answers
    if answers:
        assert there.other_versions(line) == other


def test_installed_module_gets_no_receiver() -> None:
    there = RemotePowerShell("powershell", Receiver.INSTALLED)
    sent = RemotePowerShell("powershell").frame(BUNDLE, ("-AsJson",))

    words = there.words()
    data = there.frame(BUNDLE, ("-AsJson",))

    assert "-EncodedCommand" not in words
    assert words[words.index("-File") + 1] == '"C:\\Program Files\\WindowsPowerShell\\Modules\\Rarms\\receive.ps1"'
    assert words[-2:] == ("-Version", __version__)
    assert sent == b"%08d" % len(render_receiver()) + render_receiver() + data


def test_no_target_is_an_option_of_ssh() -> None:
    words = ssh_words(Connect(ssh="-oProxyCommand=evil"))

    assert words[-2:] == ("--", "-oProxyCommand=evil")


def test_what_connect_says_comes_ahead_of_the_target() -> None:
    connect = Connect(
        ssh="ann@cell", port=2222, key="/keys/the cell", jump="gate.example", control_path="~/.ssh/rarms-%C"
    )

    words = ssh_words(connect)

    options = dict(word.split("=") for word in words[1 : words.index("--")] if "=" in word)
    assert options["Port"] == "2222"
    assert options["IdentityFile"] == '"/keys/the cell"'
    assert options["ProxyJump"] == "gate.example"
    assert (options["ControlPath"], options["ControlMaster"]) == ("~/.ssh/rarms-%C", "auto")


def test_frame_begins_with_lengths_and_digests() -> None:
    data = THERE.frame(BUNDLE, ("-AsJson",))
    receiver = render_receiver()
    assert data.startswith(b"%08d" % len(receiver) + receiver)
    data = data[8 + len(receiver) :]

    length = int(data[:8])
    first, second = hashlib.sha256(b"do\r\n").hexdigest(), hashlib.sha256(b"undo\r\n").hexdigest()
    assert data[8 : 8 + length].decode() == f"-AsJson\ncell.ps1 4 {first}\ncell.undo.ps1 6 {second}"
    assert data[8 + length :] == b"do\r\nundo\r\n"


@pytest.mark.parametrize(
    "name", ["../a.ps1", "A.ps1", "a.txt", ".ps1", "a b.ps1", "a.ps1\n", "Rarms/a.ps1", "Rarms.psd1"]
)
def test_name_that_is_no_scripts_is_not_sent(name: str) -> None:
    with pytest.raises(ValueError, match="name"):
        THERE.frame(ScriptBundle(runs=name, files={name: "x"}), ())


def test_module_goes_into_folder_of_its_own() -> None:
    data = THERE.frame(
        ScriptBundle(runs="a.ps1", files={"a.ps1": "x", "Rarms/Rarms.psm1": "y", "Rarms/Rarms.psd1": "z"}), ()
    )

    assert data.endswith(b"xzy")


@pytest.mark.parametrize(
    ("waits", "abandoning", "expected"),
    [
        (WaitLimits(), False, ("-AsJson", "-Force")),
        (WaitLimits(lock_ms=1), False, ("-AsJson", "-Force", "-LockTimeout", "1")),
        (WaitLimits(lock_ms=60_000), True, ("-AsJson", "-Force", "-LockTimeout", "60", "-Abandon")),
        (WaitLimits(lock_ms=10**15), False, ("-AsJson", "-Force", "-LockTimeout", "999999")),
    ],
)
def test_arguments_are_those_that_the_bootstrap_takes(
    waits: WaitLimits, abandoning: bool, expected: tuple[str]
) -> None:
    arguments = arguments_of(waits, abandoning=abandoning)
    pattern = re.search(r"-cmatch '(\^\( .*?\$)'", render_receiver().decode("ascii"))

    assert arguments == expected
    assert pattern
    assert re.fullmatch(pattern[1], " ".join(arguments))
