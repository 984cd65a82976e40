"""What a robot may answer: rarms takes what its own version says, and names everything else."""

import json
import sys
from typing import Any

import pytest

from rarms_iac.model.version import __version__
from rarms_iac.providers.channel import ProgramChannel
from rarms_iac.providers.interface import UNHEARD, HostError, HostFailed
from rarms_iac.providers.robot import LINE_LIMIT, READY, OtherVersion, RobotByChannel, entry_command
from tests.builders import a_host

pytestmark = pytest.mark.needs("posix")


def answering(program: str) -> RobotByChannel:
    """A robot behind a channel whose other end is this program of Python."""
    return RobotByChannel(
        a_host(), ProgramChannel(host="onboard", target="cell", words=(sys.executable, "-c", program))
    )


def error_of(program: str, job: Any = None) -> HostError:
    with pytest.raises(HostError) as raised:
        answering(program).ask("look", job, UNHEARD)
    return raised.value


def saying(*lines: str) -> str:
    return f"print({chr(10).join(lines)!r})"


@pytest.mark.parametrize(
    ("program", "message"),
    [
        (saying("Welcome!", "Last login: today"), "rarms does not start on cell"),
        (saying("Welcome!", READY), "the connection to cell broke"),
        (saying(READY, "Segmentation fault"), "not of rarms"),
        (saying(READY, "[" * 100_000), "not of rarms"),
        (saying(READY, '["result"]'), "not of rarms"),
        (saying(READY, '{"kind":"call","target":"steps","method":"__init__","arguments":[]}'), "not of rarms"),
        (saying(READY, '{"kind":"call","target":7,"method":"x","arguments":[]}'), "not of rarms"),
        (saying(READY, '{"kind":"failure","outcome":"failed"}'), "not of rarms"),
        (saying(READY, '{"kind":"failure","outcome":"perfect","findings":[]}'), "not of rarms"),
        (f"import sys; print({READY!r}); sys.stdout.buffer.write(bytes(2 ** 26 + 9))", "not of rarms"),
        ("while True: print('noise')", "did not start what it was asked for"),
        ("import sys; sys.exit('rarms: not found')", "rarms: not found"),
    ],
    ids=["login", "cut", "text", "deep", "list", "method", "kinds", "no-findings", "outcome", "64MiB", "noise", "code"],
)
def test_garbage_of_a_robot_is_named(program: str, message: str) -> None:
    error = error_of(program)

    assert message in error.message
    assert len(error.message) < 1_000


def test_more_than_64_mib_are_not_sent() -> None:
    error = error_of("raise SystemExit(1)", "x" * LINE_LIMIT)

    assert f"at most {LINE_LIMIT:,} are sent" in error.message


def test_another_version_is_named_with_the_command() -> None:
    error = error_of(saying("Welcome!", "rarms: installed current 0.0.8 0.0.9"))

    assert isinstance(error, OtherVersion)
    assert isinstance(error, HostFailed)
    assert error.message == f"it has rarms 0.0.8, 0.0.9; this is rarms {__version__}"


def test_noise_of_a_login_is_passed_over() -> None:
    answer = json.dumps({"kind": "result", "value": 7})

    assert answering(saying("Welcome!", READY, answer)).ask("look", None, UNHEARD) == 7


def test_no_text_of_manifest_is_in_command() -> None:
    robot = answering("pass")
    hostile = a_host(name="on$(reboot)board")

    assert robot.name not in entry_command()
    assert entry_command() == entry_command(__version__)
    assert RobotByChannel(hostile, robot._channel).name not in entry_command()
