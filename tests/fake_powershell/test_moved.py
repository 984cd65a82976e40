"""A host that moved is refused before anything is done; so are two machines that cannot be told apart."""

from tests.fake_powershell.cell import apply, apply_script, undo
from tests.fake_powershell.cells import Prepared, everything, fresh
from tests.fake_powershell.host import Entry, WindowsHost
from tests.fake_powershell.observing import PROFILE, document_of, state_of
from tests.fake_powershell.run import Ran, run

GAMES = f"{PROFILE}\\Tasks\\Games"


def again(host: WindowsHost, plan: Prepared) -> Ran:
    return run(host, apply_script(plan.plan))


def test_late_moved_step_stops_the_first() -> None:
    prepared = everything()
    host = prepared.copy()
    key = host.key(GAMES)
    assert key is not None
    key.values["priority"] = Entry(name="Priority", kind="DWord", data=1)
    before = document_of(host)

    ran = apply(host, prepared.plan)

    assert ran.code == 3, ran.says
    assert "task/Games" in ran.says
    assert document_of(host) == before  # the journal with its serial, too
    assert "begun" not in {event["status"] for event in ran.events}


def test_change_after_kill_is_refused_before_finishing() -> None:
    prepared = everything()
    host = prepared.after_a_run(kill_before=len(prepared.effects()) - 1)
    host.machine("vision").weight = 77

    ran = again(host, prepared)

    assert ran.code == 3, ran.says
    assert "weight" in ran.says
    own = ("owner.txt", "Set-Acl", ".result.json")
    assert [effect for effect in host.effects if not any(word in effect for word in own)] == []


def test_a_run_whose_last_look_disagrees_stays_unfinished() -> None:
    prepared = fresh()
    host = prepared.copy()

    def meddle(there: WindowsHost) -> None:
        for vm in there.vms.values():
            if vm.name == "planning" and vm.state == "Running":
                vm.weight = 33

    host.watch = meddle
    ran = apply(host, prepared.plan)
    host.watch = None

    assert ran.code == 1, ran.says
    assert "weight" in ran.says
    assert again(host, prepared).code == 3
    assert undo(host, prepared.plan).code in (0, 3)


def test_two_marks_count_for_no_partition() -> None:
    prepared = everything()
    host = prepared.copy()
    vm = host.machine("vision")
    vm.notes += "\r\nrarms/1 other/thing vm=" + vm.id[:8].lower() + " set=0123456789ab"

    ran = apply(host, prepared.plan)

    assert ran.code == 3, ran.says
    assert [
        partition.mark for partition in state_of(host, "onboard").partitions if partition.settings.name == "vision"
    ] == [None]


def test_value_in_another_case_is_same_value() -> None:
    prepared = everything()
    host = prepared.copy()
    key = host.key(GAMES)
    assert key is not None
    for entry in key.values.values():
        entry.name = entry.name.upper()

    ran = apply(host, prepared.plan)

    assert ran.code == 0, ran.says
    left = prepared.cell.on(host).plan()
    assert [str(step.address) for step in left.hosts[0].steps] == []
