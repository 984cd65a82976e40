"""Machines that look like ours and over which something else decides: replicas, clusters, shielded machines."""

from dataclasses import replace
from functools import cache

import pytest

from rarms_iac.model.mmcss import SYSTEM_RESPONSIVENESS
from rarms_iac.model.plan import Purpose
from rarms_iac.model.state import RegistryValue, ValueKind
from rarms_iac.model.system import HypervPartition
from tests.builders import a_component, a_partition
from tests.fake_powershell.cell import Cell, apply, apply_script, scripts_of, undo
from tests.fake_powershell.cells import Prepared, a_cell_system, a_stranger, a_windows, everything, fresh
from tests.fake_powershell.host import Entry, Vm, WindowsHost
from tests.fake_powershell.observing import PROFILE, RECORDS, document_of, seen, state_of
from tests.fake_powershell.run import Ran, run


def cell(host: WindowsHost, reserve: int = 10, *, clustered: bool | None = None) -> Cell:
    partition = replace(a_partition("vision"), hyperv=HypervPartition(clustered=clustered))
    return Cell(a_cell_system(a_component("vision", reserve=f"{reserve} %"), partitions=(partition,)), host)


def made() -> WindowsHost:
    return _made().copy()


@cache
def _made() -> WindowsHost:
    host = a_windows()
    assert apply(host, cell(host).plan()).code == 0
    return host


def the_machine(host: WindowsHost) -> Vm:
    return host.machine("vision")


@pytest.mark.parametrize("mode", ["Replica", "TestReplica", "ExtendedReplica"])
def test_replica_is_stranger_whose_name_is_taken(mode: str) -> None:
    host = made()
    the_machine(host).replication_mode = mode
    the_machine(host).state = "Off"

    found = cell(host, 20).prepare()

    assert found.plan is None
    (replica,) = cell(host).observe().partitions
    assert (replica.mark, replica.claims_resources) == (None, False)
    assert "replica of a machine on another host" in replica.foreign_mark


def test_a_primary_is_ours() -> None:
    host = made()
    the_machine(host).replication_mode = "Primary"

    assert apply(host, cell(host, 20).plan()).code == 0


@pytest.mark.parametrize(
    ("tie", "words"),
    [
        ({"replication_mode": "Replica"}, "a replica of a machine on another host"),
        ({"clustered": "True"}, "part of a failover cluster"),
        ({"shielded": True}, "shielded"),
    ],
    ids=["replica", "cluster", "shielded"],
)
@pytest.mark.parametrize("purpose", [Purpose.APPLY, Purpose.DESTROY])
def test_tied_machine_is_refused_by_name(tie: dict[str, object], words: str, purpose: Purpose) -> None:
    host = made()
    plan = cell(host, 20).plan(purpose=purpose)
    for name, value in tie.items():
        setattr(the_machine(host), name, value)
    before = seen(host)

    ran = apply(host, plan)

    assert ran.code == 3, ran.says
    assert f"vision ({the_machine(host).id}) is {words} and is not changed" in ran.events[-1]["detail"]
    assert seen(host) == before


def test_clustered_machine_needs_permission_and_tells_cluster() -> None:
    host = made()
    the_machine(host).clustered, the_machine(host).cluster_knows = "True", False

    refused = cell(host, 20).prepare()
    plan = cell(host, 20, clustered=True).plan()
    ran = apply(host, plan)

    assert (refused.plan, "RARMS152" in [finding.code for finding in refused.findings]) == (None, True)
    assert ran.code == 0, ran.says
    assert (the_machine(host).reserve, the_machine(host).cluster_knows) == (20, True)
    assert apply(host, plan).code == 0


UPDATE = "Update-ClusterVirtualMachineConfiguration"


def test_cluster_is_told_however_a_run_is_cut_off() -> None:
    host = made()
    the_machine(host).clustered = "True"
    plan = cell(host, 20, clustered=True).plan()
    whole = host.copy()
    assert apply(whole, plan).code == 0
    update = next(at for at, effect in enumerate(whole.effects) if UPDATE in effect)
    steps = [at for at, effect in enumerate(whole.effects) if "VM" in effect or UPDATE in effect]
    faults = [(fault, at) for fault in ("kill_before", "kill_after", "fail_at") for at in range(steps[0], update + 2)]

    for fault, at in faults:
        cut = host.copy(**{fault: at})
        the_machine(cut).cluster_knows = False
        first = apply(cut, plan)
        cut = cut.copy()
        ended = apply(cut, plan)
        undone = undo(cut, plan)

        assert (first.code, ended.code) != (0, 1), first.says
        assert (ended.code, undone.code) == (0, 0), f"{fault} {at}\n{ended.says}\n{undone.says}"
        assert the_machine(cut).cluster_knows, f"{fault} {at}"


def test_second_run_tells_no_cluster() -> None:
    host = made()
    the_machine(host).clustered = "True"
    plan = cell(host, 20, clustered=True).plan()
    assert apply(host, plan).code == 0
    the_machine(host).cluster_knows = False

    again = apply(host, plan)

    assert (again.code, the_machine(host).cluster_knows) == (0, False), again.says


def test_clustered_machine_is_never_removed() -> None:
    host = made()
    the_machine(host).clustered = "True"

    found = cell(host, clustered=True).prepare(purpose=Purpose.DESTROY)

    assert (found.plan, "RARMS152" in [finding.code for finding in found.findings]) == (None, True)


def test_stopped_replica_takes_no_room() -> None:
    host = made()
    plan = cell(host, 80).plan()
    greedy = a_stranger("greedy", 9, processors=4, reserve=60, state="Off", start_action="Start")
    host.vms[greedy.id] = greedy

    refused = apply(host.copy(), plan)
    greedy.replication_mode = "Replica"
    ran = apply(host, plan)

    assert (refused.code, ran.code) == (1, 0), f"{refused.says}\n{ran.says}"


def test_scripts_of_unclustered_machine_name_no_cluster() -> None:
    host = made()
    prepared = Prepared(cell(host), cell(host, 20).plan())

    assert all(b"FailoverClusters" not in script for script in scripts_of(prepared.plan).values())


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
