"""SystemResponsiveness on the fake: set, found again, set otherwise, and brought back as it was or was not."""

import pytest

from rarms_iac.model.mmcss import SYSTEM_RESPONSIVENESS
from rarms_iac.model.state import RegistryValue, ValueKind
from tests.builders import a_component
from tests.fake_powershell.cell import Cell, apply
from tests.fake_powershell.cells import a_cell_system, a_windows
from tests.fake_powershell.host import Entry, WindowsHost
from tests.fake_powershell.observing import PROFILE, RECORDS, state_of

RECORD = f"{RECORDS}\\robot\\{SYSTEM_RESPONSIVENESS}"
BEFORE = {
    "nothing": None,
    "as Windows has it": Entry(name=SYSTEM_RESPONSIVENESS, kind="DWord", data=20),
    "in another case": Entry(name="systemresponsiveness", kind="DWord", data=4294967295),
    "a text": Entry(name=SYSTEM_RESPONSIVENESS, kind="String", data="14"),
}
befores = pytest.mark.parametrize("before", [pytest.param(value, id=name) for name, value in BEFORE.items()])


def a_host(before: Entry | None) -> WindowsHost:
    host = a_windows()
    if before is not None:
        host.add_key(PROFILE).values[before.name.lower()] = before
    return host


def there(host: WindowsHost) -> tuple[str, int | str] | None:
    key = host.key(PROFILE)
    assert key is not None
    entry = key.values.get(SYSTEM_RESPONSIVENESS.lower())
    return (entry.kind.lower(), entry.data) if entry else None


def wanting(host: WindowsHost, percent: int | None) -> Cell:
    return Cell(a_cell_system(a_component("vision", reserve="10 %"), responsiveness=percent), host)


def as_before(before: Entry | None) -> tuple[str, int | str] | None:
    return (before.kind.lower(), before.data) if before else None


@befores
def test_responsiveness_is_set_changed_and_restored(before: Entry | None) -> None:
    host = a_host(before)

    for percent in (10, 90):
        plan = wanting(host, percent).plan()
        assert "mmcss/responsiveness" in [str(change.address) for change in plan.hosts[0].changes]
        ran = apply(host, plan)
        assert ran.code == 0, ran.says
        assert there(host) == ("dword", percent)
        assert wanting(host, percent).plan().hosts[0].steps == ()
        seen = state_of(host, "onboard")
        assert seen.responsiveness is not None
        assert seen.responsiveness.value == RegistryValue(kind=ValueKind.DWORD, data=percent)
        assert [task.name for task in seen.tasks] == ["Games"]  # its record is none of a task class

    ran = apply(host, wanting(host, None).plan())

    assert ran.code == 0, ran.says
    assert there(host) == as_before(before)
    assert host.key(RECORD) is None
    assert wanting(host, None).plan().hosts[0].steps == ()


def test_script_refuses_where_it_was_changed_since_plan() -> None:
    host = a_host(BEFORE["as Windows has it"])
    plan = wanting(host, 10).plan()
    host.add_key(PROFILE).values[SYSTEM_RESPONSIVENESS.lower()].data = 50

    ran = apply(host, plan)

    assert ran.code == 3
    assert there(host) == ("dword", 50)
