"""The whole way on Windows: rarms in its own CPython, the real PowerShell that it starts, and a host of the model."""

import re
from collections.abc import Iterator
from pathlib import Path

import pytest

from tests.effort import LONG
from tests.fake_powershell.cells import a_stranger, a_windows
from tests.fake_powershell.host import WindowsHost
from tests.real_powershell.engines import finish
from tests.real_powershell.on_windows import RarmsOnWindows, rarms_on
from tests.real_powershell.runner import RealPowerShell
from tests.remote import Ended

pytestmark = pytest.mark.needs("powershell-windows", "wine", "windows-python")

MANIFEST = r"""
schema: rarms/v1
application: { name: robot }
hosts:
  onboard:
    provider: hyperv
    logical_processors: 4
    memory: 8 GiB
    keep_for_host: { memory: 512 MiB }
    hyperv: { image: 'D:\images\robot''s.vhdx', vm_path: 'D:\vms' }
components:
  vision: { criticality: 50, memory: 1 GiB, processors: 2, cpu: { reserve: 20 % } }
  speech: { criticality: 40, memory: 1 GiB, processors: 1, cpu: { reserve: 10 % } }
  watcher: { criticality: 3, runs_on: host, task: Localization }
"""
UNCHANGED = "No changes."


@pytest.fixture
def host() -> WindowsHost:
    """A server with a machine that is not managed."""
    return a_windows(a_stranger())


@pytest.fixture
def cell(real: RealPowerShell, host: WindowsHost, tmp_path: Path) -> Iterator[RarmsOnWindows]:
    """A folder with the manifest, on that server."""
    (tmp_path / "rarms.yaml").write_text(MANIFEST, encoding="utf-8", newline="\n")
    with rarms_on(real, host, tmp_path) as cell:
        yield cell


def machines(host: WindowsHost) -> set[str]:
    return {vm.name for vm in host.vms.values()}


def done(cell: RarmsOnWindows, *words: str) -> Ended:
    """A command that ends well."""
    ended = cell.rarms(*words)
    assert ended.code == 0, ended
    return ended


@pytest.mark.sample
def test_every_command_on_windows(cell: RarmsOnWindows, host: WindowsHost) -> None:
    planned = done(cell, "plan")
    assert "3 to add" in planned.out
    assert host.effects == []
    done(cell, "apply", "--auto-approve")
    assert machines(host) == {"backup", "vision", "speech"}
    assert UNCHANGED in done(cell, "plan").out
    host.machine("vision").reserve = 15
    drifted = cell.rarms("drift")
    assert (drifted.code, "vision" in drifted.out) == (2, True), drifted
    assert "speech" in done(cell, "status").out
    done(cell, "apply", "--auto-approve")
    assert host.machine("vision").reserve == 40
    done(cell, "undo", "--auto-approve")
    assert host.machine("vision").reserve == 15
    done(cell, "destroy", "--auto-approve")
    assert machines(host) == {"backup"}
    assert re.findall("(apply|undo|destroy) .* (done|undone)", done(cell, "history").out) == [
        ("destroy", "done"),
        ("undo", "done"),
        ("apply", "undone"),
        ("apply", "done"),
    ]
    assert cell.left_behind() == []


EFFECTS = 74
"""What an apply of the manifest changes, about: kills are spread over it."""
POINTS = [EFFECTS * at // 10 + 3 for at in range(10)] if LONG else [EFFECTS // 2]
WHO = {"powershell": ("pwsh.exe",), "rarms": ("python.exe",), "both": ("python.exe", "pwsh.exe")}


@pytest.mark.parametrize("at", POINTS)
@pytest.mark.parametrize("who", WHO if LONG else ["powershell", "rarms"])
def test_next_command_goes_on_after_a_kill(cell: RarmsOnWindows, host: WindowsHost, who: str, at: int) -> None:
    killed = cell.watch(at, lambda: cell.kill(*WHO[who]))

    ended = finish(cell.start("apply", "--auto-approve"))

    cell.wait_until(lambda: not cell.running("pwsh.exe"))
    assert killed.is_set()
    assert ended.code != 0, ended
    done(cell, "apply", "--auto-approve")
    assert UNCHANGED in done(cell, "plan").out
    assert machines(host) == {"backup", "vision", "speech"}
    assert host.machine("backup").notes == "keep me"


def test_looks_do_not_disturb_an_apply(cell: RarmsOnWindows, host: WindowsHost) -> None:
    running = cell.start("apply", "--auto-approve")
    looks: list[Ended] = []
    while running.poll() is None:
        looks.append(cell.rarms("status"))

    applied = finish(running)

    assert applied.code == 0, applied
    assert len(looks) >= 2
    assert [look for look in looks if look.code not in (0, 2)] == []
    assert machines(host) == {"backup", "vision", "speech"}
