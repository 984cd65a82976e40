import hashlib
import re
from base64 import b64decode

import pytest

from rarms_iac.model.host import Connect, Receiver
from rarms_iac.model.version import __version__
from rarms_iac.providers.channel import ssh_words
from rarms_iac.providers.hyperv.bootstrap import RemotePowerShell, arguments_of, command, render_loader, render_receiver
from rarms_iac.providers.interface import ScriptBundle, WaitLimits
from tests.powershell_lint.tree import parse, text_of, walk

SCRIPT = ScriptBundle(runs="cell.ps1", files={"cell.undo.ps1": "undo\r\n", "cell.ps1": "do\r\n"})

THERE = RemotePowerShell("powershell")

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
    sent = RemotePowerShell("powershell").frame(SCRIPT, ("-AsJson",))

    words = there.words()
    data = there.frame(SCRIPT, ("-AsJson",))

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
    data = THERE.frame(SCRIPT, ("-AsJson",))
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
