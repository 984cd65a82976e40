"""From observations to states: rights, schedulers, marks, task classes, journals."""

import pytest

from rarms_iac.model.host import ProviderKind, SchedulerType, host_identity
from rarms_iac.model.journal import ScriptRun
from rarms_iac.model.state import RegistryValue, Rights, RunState, StartAction, StopAction, TaskRecord, ValueKind
from rarms_iac.providers.hyperv.condition import findings_of
from rarms_iac.providers.hyperv.observation import HostObservation, Unread
from rarms_iac.providers.hyperv.parse import (
    UnusableJournal,
    last_run,
    last_run_of,
    run_state,
    serials_of,
    tasks_of,
    to_state,
)
from rarms_iac.storage.append import sealed_line
from rarms_iac.storage.codec import NotDecodable
from tests.recorded_hosts import document, recorded, unread


def test_the_facts_of_a_server() -> None:
    facts = to_state(recorded("server-2022-with-strangers"), "cell").facts

    assert (facts.name, facts.computer_name, facts.provider) == ("cell", "CELL-4", ProviderKind.HYPERV)
    assert (facts.os_build, facts.client, facts.smt) == (20348, False, True)
    assert (facts.logical_processors, facts.memory) == (8, 34267521024)
    assert (facts.scheduler, facts.rights) == (SchedulerType.CORE, Rights.PROVEN)
    assert facts.id == host_identity("5b0f6a3e-9d1c-4d57-8b7e-2f6a1c0d9e84")


def test_strangers_and_ours() -> None:
    state = to_state(recorded("server-2022-with-strangers"), "cell")

    assert [partition.settings.name for partition in state.partitions] == [
        "dc01",
        "historian",
        "old-panel",
        "seam-tracking",
    ]
    dc, historian, _, ours = state.partitions
    assert (dc.mark, dc.settings.start_action, dc.state) == (None, StartAction.START, RunState.RUNNING)
    assert dc.other_notes.startswith("Domain controller")
    assert (historian.settings.dynamic_memory, historian.settings.stop_action) == (True, StopAction.SAVE)
    assert ours.mark is not None
    assert (ours.mark.application, ours.mark.name, ours.other_notes) == (
        "welding-cell",
        "seam-tracking",
        "Camera on port 3.",
    )


def test_every_state_has_a_meaning() -> None:
    state = to_state(recorded("machines-in-every-state"), "onboard")

    told = {partition.settings.name.removeprefix("in-"): partition.state for partition in state.partitions}
    assert told == {
        "off": RunState.OFF,
        "running": RunState.RUNNING,
        "paused": RunState.PAUSED,
        "saved": RunState.SAVED,
        "runningcritical": RunState.CRITICAL,
        "offcritical": RunState.CRITICAL,
        "pausedcritical": RunState.CRITICAL,
    } | dict.fromkeys(
        ["starting", "stopping", "saving", "hibernated", "fastsaved", "componentservicing"], RunState.BUSY
    )
    assert [partition.settings.name for partition in state.partitions if partition.settings.running] == ["in-running"]
    assert run_state("SomethingNewInServer2031") is RunState.BUSY


@pytest.mark.parametrize(
    ("seen", "expected"),
    [
        (recorded("empty-host"), Rights.PROVEN),
        (recorded("empty-host", elevated=False), Rights.PROVEN),
        (recorded("empty-host", host_visible=False), Rights.PROVEN),
        (recorded("empty-host", elevated=False, host_visible=False), Rights.MISSING),
        (recorded("unprivileged-caller"), Rights.MISSING),
        (unread("empty-host", "machines", status="denied"), Rights.MISSING),
        (unread("empty-host", "machines"), Rights.UNKNOWN),
        (unread("empty-host", "elevated", "host_visible"), Rights.PROVEN),
        (unread("empty-host", "elevated", "host_visible", status="denied"), Rights.MISSING),
        (unread("empty-host", "elevated", "host_visible", "hypervisor"), Rights.UNKNOWN),
    ],
)
def test_rights_are_proven_and_not_assumed(seen: HostObservation, expected: Rights) -> None:
    assert to_state(seen, "onboard").facts.rights is expected


def test_without_proven_rights_no_machine_is_believed() -> None:
    seen = recorded("server-2022-with-strangers", elevated=False, host_visible=False)

    assert to_state(seen, "cell").partitions == ()


def test_task_classes_have_types_and_records_that_count() -> None:
    tasks = {task.name: task for task in tasks_of(recorded("server-2022-with-strangers"))}

    assert tasks["Pro Audio"].values["Priority"] == RegistryValue(kind=ValueKind.DWORD, data=1)
    assert tasks["Games"].values["Latency Sensitive"] == RegistryValue(kind=ValueKind.EXPAND_SZ, data="False")
    assert tasks["MotionControl"].record == TaskRecord(application="welding-cell", set="fedcba987654", before=None)
    assert "Half" not in tasks
    gone = tasks["Gone"]
    assert gone.record is not None
    assert (gone.values, gone.record.before) == ({}, {"Priority": RegistryValue(kind=ValueKind.DWORD, data=2)})


def test_record_of_task_class_names_its_robot() -> None:
    texts = {"before": "null", "robot": "robot-7", "set": "fedcba987654"}
    values = [{"name": name, "kind": "String", "data": data} for name, data in texts.items()]
    seen = recorded("empty-host", records=[{"application": "cell", "task": "Games", "values": values}])

    (task,) = [task for task in tasks_of(seen) if task.record]

    assert task.record == TaskRecord(application="cell", robot="robot-7", set="fedcba987654", before=None)


def test_foreign_record_is_not_guessed() -> None:
    values = [{"name": "before", "kind": "String", "data": "{"}, {"name": "set", "kind": "String", "data": "a"}]
    seen = recorded("empty-host", records=[{"application": "robot", "task": "Games", "values": values}])

    with pytest.raises(NotDecodable, match=r"records\.robot\.Games\.before"):
        tasks_of(seen)


def test_enumeration_that_hyperv_does_not_have_is_refused() -> None:
    machines = document("server-2022-with-strangers")["machines"]["value"]
    machines[0]["start_action"] = "Perhaps"

    with pytest.raises(NotDecodable, match='"Perhaps" is none of Nothing'):
        to_state(recorded("server-2022-with-strangers", machines=machines), "cell")


def test_the_serials_come_from_a_journal_of_administrators() -> None:
    assert serials_of(recorded("server-2022-with-strangers")) == {"other": 1, "welding-cell": 3}
    assert serials_of(recorded("event-log-rolled-over")) == {}
    assert serials_of(recorded("empty-host")) == {}
    assert last_run_of(recorded("empty-host")) is None


def test_killed_run_is_unfinished() -> None:
    journal = recorded("server-2022-with-strangers").journal
    assert not isinstance(journal, Unread)
    whole = journal.text.splitlines(keepends=True)

    run = last_run("S-1-5-18", "".join(whole[:3]) + whole[3][:40])

    assert isinstance(run, ScriptRun)
    assert (run.unfinished, run.touched(), run.started.plan) == (True, frozenset({0}), "0123456789ab")
    ended = last_run_of(recorded("server-2022-with-strangers"))
    assert isinstance(ended, ScriptRun)
    assert (ended.unfinished, ended.touched()) == (False, frozenset({0, 1}))


def test_a_planted_and_a_damaged_journal_say_nothing() -> None:
    journal = recorded("server-2022-with-strangers").journal
    assert not isinstance(journal, Unread)
    text = journal.text
    extra = sealed_line({"number": 0, "status": "begun", "kind": "step_recorded"}).decode()

    planted = last_run("S-1-5-21-1-2-3-1013", text)
    assert isinstance(planted, UnusableJournal)
    assert "belongs to S-1-5-21-1-2-3-1013" in planted.problem
    assert isinstance(last_run("S-1-5-18", text.replace("begun", "other", 1)), UnusableJournal)
    assert isinstance(last_run("S-1-5-18", text + extra), UnusableJournal)
    assert isinstance(last_run("S-1-5-18", sealed_line({"kind": "step_recorded"}).decode()), UnusableJournal)
    assert isinstance(last_run("S-1-5-18", ""), UnusableJournal)
    assert isinstance(last_run("S-1-5-18", text.replace("\n", "\r")), UnusableJournal)


def test_a_reserve_that_no_cmdlet_shows_is_told() -> None:
    (told,) = findings_of(recorded("server-2022-with-strangers"), "cell")

    assert (told.code, told.address) == ("RARMS367", "machine/0a1b2c3d-4e5f-4a6b-8c7d-9e0f1a2b3c44")
    assert "35.5 %" in told.detail
    assert "show 35 %" in told.detail


def test_a_journal_that_is_not_believed_is_told() -> None:
    (told,) = findings_of(recorded("event-log-rolled-over"), "cell")

    assert (told.code, told.address) == ("RARMS190", "host/cell")
    assert "S-1-5-21-3623811015-3361044348-30300820-1013" in told.detail
    assert findings_of(recorded("empty-host"), "cell") == ()


def test_largest_node_counts_without_spanning() -> None:
    read = recorded("server-2022-with-strangers").hypervisor
    assert not isinstance(read, Unread)
    facts = {name: getattr(read, name) for name in read.__dataclass_fields__} | {"numa_spanning": False}
    nodes = [{"node": number, "memory_available": 1, "memory": 16000 + number} for number in range(2)]
    of_wmi = [{**node, "memory": 0} for node in nodes]

    left = to_state(recorded("server-2022-with-strangers", numa=nodes), "cell")
    assert (left.memory_left, left.node_left) == (2 * 2**20, 2**20)

    def largest(**probes: object) -> int | None:
        return to_state(recorded("server-2022-with-strangers", **probes), "cell").largest_node

    assert largest(hypervisor=facts, numa=nodes) == 16001 * 2**20
    assert largest(numa=nodes) is None
    assert largest(hypervisor=facts, numa=of_wmi) is None


@pytest.mark.parametrize(
    ("cores", "logical", "kinds"),
    [(14, 20, [(8, 1), (12, 2)]), (10, 20, []), (20, 20, []), (14, 16, [])],
    ids=["hybrid", "SMT", "no SMT", "minroot"],
)
def test_mixed_cores_are_told(cores: int, logical: int, kinds: list[tuple[int, int]]) -> None:
    read = recorded("empty-host").hypervisor
    assert not isinstance(read, Unread)
    whole = {name: getattr(read, name) for name in read.__dataclass_fields__} | {"logical_processors": 20}
    socket = {"name": "a processor", "cores": cores, "logical": logical}

    found = to_state(recorded("empty-host", hypervisor=whole, processors=[socket]), "cell").facts.processor_kinds

    assert [(kind.processors, kind.threads) for kind in found] == kinds
