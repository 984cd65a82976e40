"""A program that was started: its events; nothing of it lives on, and no other account looks into its folder."""

import json
import sys
import time
from pathlib import Path

import pytest

from rarms_iac.providers.channel import Channel
from rarms_iac.providers.hyperv.provider import read_event
from rarms_iac.providers.hyperv.transport import OURS_ONLY, protect
from rarms_iac.providers.interface import EventKind, EventStatus, RunEvent

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


HANDED_ON = """
import subprocess, sys
subprocess.Popen([sys.executable, "-c", "import time; time.sleep(60)"], stdout=sys.stdout, stderr=sys.stderr)
print("on", flush=True)
"""


def test_channel_ends_despite_inherited_pipes() -> None:
    """As a connection that ssh keeps for later calls may do."""
    begin = time.monotonic()
    with Channel((sys.executable, "-c", HANDED_ON)) as channel:
        assert channel.next_line(60, lambda: None) == "on"
        assert channel.code() == 0

    assert time.monotonic() - begin < 50


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
