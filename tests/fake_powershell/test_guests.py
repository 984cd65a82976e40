"""The scripts of guests on the fake, which were not looked into: done once and again, killed everywhere, undone."""

from collections.abc import Mapping
from functools import cache

import pytest

from rarms_iac.model.plan import Plan
from rarms_iac.model.state import RegistryValue, TaskClass, ValueKind
from rarms_iac.model.system import System, TaskRequest
from rarms_iac.providers.hyperv.observation import observation_of
from rarms_iac.providers.hyperv.parse import tasks_of
from tests.builders import a_component
from tests.fake_powershell.cell import Cell, apply, scripts_of, with_module
from tests.fake_powershell.cells import a_cell_system, a_windows
from tests.fake_powershell.host import Entry, WindowsHost
from tests.fake_powershell.observing import PROFILE, document_of
from tests.fake_powershell.run import Ran, put, run

SCRIPT, UNDO = "onboard.guest.vision.ps1", "onboard.guest.vision.undo.ps1"


def the_system() -> System:
    """A partition whose guest gets a class of its own and one that Windows ships."""
    return a_cell_system(
        a_component("vision", criticality=9, reserve="40 %", processors=2, task="MotionControl"),
        a_component("player", criticality=2, reserve="10 %", processors=1, task="Games", together=("vision",)),
        tasks=(TaskRequest(name="Games", replace_shipped=True),),
    )


@cache
def the_plan() -> Plan:
    """The plan that makes it."""
    return Cell(the_system(), a_windows()).plan()


@cache
def the_scripts() -> Mapping[str, bytes]:
    return with_module({name: text for name, text in scripts_of(the_plan()).items() if ".guest." in name})


OTHER = "8C0F5E9A-0000-4000-8000-000000000001"
GUEST = "HKLM:\\SOFTWARE\\Microsoft\\Virtual Machine\\Guest\\Parameters"


def a_guest(name: str = "vision", machine: str = OTHER, /, **faults: object) -> WindowsHost:
    """A Windows of another name in a machine, with Games as it ships."""
    host = a_windows(computer="VISION-1").copy(**faults)
    told = host.add_key(GUEST).values
    for value, data in (("VirtualMachineName", name), ("VirtualMachineId", machine)):
        told[value.lower()] = Entry(name=value, kind="String", data=data)
    put(host, the_scripts())
    return host


def classes(host: WindowsHost) -> dict[str, TaskClass]:
    return {task.name: task for task in tasks_of(observation_of(document_of(host)))}


def statuses(ran: Ran) -> list[str]:
    return [event["status"] for event in ran.events if event["kind"] == "step" and event["status"] != "begun"]


@pytest.mark.parametrize("windows_powershell", [True, False], ids=["5.1", "7"])
def test_classes_are_written_and_old_values_kept(windows_powershell: bool) -> None:
    guest = a_guest()
    before = classes(guest)

    ran = run(guest, SCRIPT, windows_powershell=windows_powershell)

    assert (ran.code, statuses(ran)) == (0, ["changed", "changed"]), ran.says
    after = classes(guest)
    assert after["MotionControl"].values["Scheduling Category"] == RegistryValue(kind=ValueKind.SZ, data="Medium")
    games, motion = after["Games"].record, after["MotionControl"].record
    assert games is not None
    assert motion is not None
    assert (games.application, games.before, motion.before) == (motion.application, before["Games"].values, None)
    assert "Latency Sensitive" not in after["Games"].values


def test_second_run_is_unchanged_and_undo_restores() -> None:
    guest = a_guest()
    before = classes(guest)
    assert run(guest, SCRIPT).code == 0
    done = classes(guest)

    again = run(guest, SCRIPT)
    assert (again.code, statuses(again), classes(guest)) == (0, ["unchanged", "unchanged"], done)

    undone = run(guest, UNDO)
    assert (undone.code, classes(guest)) == (0, before), undone.says


def test_earlier_run_does_not_become_the_original() -> None:
    guest = a_guest()
    before = classes(guest)
    assert run(guest, SCRIPT).code == 0
    edited = guest.add_key(f"{PROFILE}\\Tasks\\Games").values
    edited["priority"] = Entry(name="Priority", kind="String", data="7")
    guest.files = {path: file for path, file in guest.files.items() if "journal" not in path}  # as another plan's

    assert run(guest, SCRIPT).code == 0
    record = classes(guest)["Games"].record

    assert record is not None
    assert record.before == before["Games"].values


def test_class_that_is_another_tools_is_left_alone() -> None:
    guest = a_guest()
    guest.add_key(f"{PROFILE}\\Tasks\\MotionControl").values["priority"] = Entry(name="Priority", kind="DWord", data=3)

    ran = run(guest, SCRIPT)

    assert ran.code == 3
    assert ran.status_of("partition/vision/task/MotionControl") == ["refused"]
    assert classes(guest)["MotionControl"].values == {"Priority": RegistryValue(kind=ValueKind.DWORD, data=3)}


def test_script_does_not_run_on_host_itself() -> None:
    (part,) = the_plan().hosts
    host = a_windows(computer=part.facts.computer_name)
    put(host, the_scripts())

    ran = run(host, SCRIPT)

    assert ran.code == 3, ran.says
    assert "not a guest" in ran.says


@pytest.mark.parametrize("script", [SCRIPT, UNDO])
def test_script_refuses_guest_of_another_machine(script: str) -> None:
    guest = a_guest("speech")
    before = classes(guest)

    ran = run(guest, script)

    assert ran.code == 3, ran.says
    assert "not of vision" in ran.says
    assert classes(guest) == before


def test_existing_machine_is_known_by_id() -> None:
    cell = Cell(the_system(), a_windows())
    host = cell.host.copy()
    assert apply(host, the_plan()).code == 0
    scripts = with_module({name: text for name, text in scripts_of(cell.on(host).plan()).items() if ".guest." in name})
    machine = host.machine("vision").id
    own, namesake = a_guest("vision", machine.upper()), a_guest()
    for guest in (own, namesake):
        put(guest, scripts)

    assert run(own, SCRIPT).code == 0
    refused = run(namesake, SCRIPT)

    assert refused.code == 3, refused.says
    assert machine in refused.says


@pytest.mark.parametrize(
    ("name", "kind"),
    [*((name, "DWord") for name in ("a*", "PSObject", "psbase", "", "(Default)")), ("Extra", "MultiString")],
)
def test_class_with_unrestorable_name_is_not_taken(name: str, kind: str) -> None:
    guest = a_guest()
    values = guest.add_key(f"{PROFILE}\\Tasks\\Games").values
    values[name.lower()] = Entry(name=name, kind=kind, data="a b" if kind == "MultiString" else 1)
    before = classes(guest)

    ran = run(guest, SCRIPT)

    assert ran.code == 3, ran.says
    assert "taken" in ran.says
    assert classes(guest) == before


@pytest.mark.parametrize("script", [SCRIPT, UNDO])
def test_class_with_default_value_is_refused_first(script: str) -> None:
    guest = a_guest()
    assert run(guest, SCRIPT).code == 0
    for task in ("Games", "MotionControl"):
        guest.add_key(f"{PROFILE}\\Tasks\\{task}").values[""] = Entry(name="", kind="String", data="somebody's")
    guest.files = {path: file for path, file in guest.files.items() if script == UNDO or "journal" not in path}
    before = classes(guest)

    ran = run(guest, script)

    assert ran.code == 3, ran.says
    assert "taken" in ran.says
    assert classes(guest) == before


def test_powershell_of_32_bits_is_refused() -> None:
    guest = a_guest()
    guest.bits = 32
    before = classes(guest)

    ran = run(guest, SCRIPT)

    assert ran.code == 3, ran.says
    assert "32 bits" in ran.says
    assert classes(guest) == before
