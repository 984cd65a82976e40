"""From observations to states: rights, schedulers, marks, task classes, journals."""

import json
from dataclasses import replace
from typing import Any

import pytest

from rarms_iac.model.host import ProviderKind, SchedulerType, host_identity
from rarms_iac.model.journal import ScriptRun
from rarms_iac.model.run import SampleCount, Samples, TimeField
from rarms_iac.model.seen_host import PolicyScope
from rarms_iac.model.state import RegistryValue, Rights, RunState, StartAction, StopAction, TaskRecord, ValueKind
from rarms_iac.model.system import run_of
from rarms_iac.providers.hyperv.condition import condition_of, findings_of
from rarms_iac.providers.hyperv.guest_samples import GuestRun
from rarms_iac.providers.hyperv.observation import HostObservation, Unread, is_observation, or_else
from rarms_iac.providers.hyperv.parse import (
    UnusableJournal,
    last_run,
    last_run_of,
    run_state,
    serials_of,
    tasks_of,
    to_state,
)
from rarms_iac.providers.measuring import PartitionWork, Work
from rarms_iac.storage.codec import NotDecodable
from rarms_iac.storage.records import sealed_line
from tests.builders import a_component, at_least, at_most
from tests.recorded_hosts import NAMES, document, read_observation, recorded, recorded_bytes, unread


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

    with pytest.raises(NotDecodable, match='"Perhaps" is not one of Nothing'):
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
    nodes = [{"memory_available": 1, "memory": 16000 + number} for number in range(2)]
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


@pytest.mark.parametrize("name", NAMES)
def test_every_recorded_answer_is_read(name: str) -> None:
    seen = recorded(name)

    assert seen.computer
    assert is_observation(document(name))


def test_redirected_by_windows_powershell_it_says_the_same() -> None:
    redirected = recorded_bytes("redirected-by-windows-powershell")

    assert redirected.startswith(b"\xff\xfe{\0")
    assert read_observation(redirected) == recorded("empty-host")


@pytest.mark.parametrize("encoding", ["utf-8", "utf-8-sig", "utf-16", "utf-16-le", "utf-16-be"])
def test_no_encoding_that_a_powershell_writes_is_lost(encoding: str) -> None:
    text = json.dumps(document("client-with-root-scheduler"))

    assert read_observation(text.encode(encoding)) == recorded("client-with-root-scheduler")


@pytest.mark.parametrize("encoding", ["utf-8", "utf-8-sig", "utf-16"])
def test_what_profile_says_around_document_is_skipped(encoding: str) -> None:
    line = json.dumps(document("client-with-root-scheduler"), separators=(",", ":"))
    noisy = f"Welcome, administrator\r\n{line}\r\nWARNING: {{ goodbye\r\n"

    assert read_observation(noisy.encode(encoding)) == recorded("client-with-root-scheduler")


def test_a_probe_is_a_value_absent_or_denied() -> None:
    seen = recorded("unprivileged-caller")

    assert seen.machines == ()
    assert isinstance(seen.hypervisor, Unread)
    assert seen.hypervisor.status == "denied"
    assert isinstance(seen.records, Unread)
    assert seen.records.status == "absent"
    assert or_else(seen.records, ()) == ()


def test_an_older_script_did_not_look() -> None:
    answer = document("empty-host")
    del answer["execution_policy"]

    seen = read_observation(json.dumps(answer).encode())

    assert isinstance(seen.execution_policy, Unread)
    assert seen.execution_policy.error == "NotLookedFor"


def changed(path: str, value: Any) -> bytes:
    """The server's answer with one value in another place; None takes it away."""
    answer = document("server-2022-with-strangers")
    at: Any = answer
    *way, last = path.split("/")
    for word in way:
        at = at[int(word) if word.isdigit() else word]
    if value is None:
        del at[last]
    else:
        at[last] = value
    return json.dumps(answer).encode()


@pytest.mark.parametrize(
    ("path", "value", "where"),
    [
        ("format", "rarms-observation/2", "format"),
        ("computer", 7, "the document"),
        ("bitlocker", {"status": "value", "value": 1}, "bitlocker"),
        ("elevated", True, "elevated"),
        ("elevated", {"status": "perhaps", "error": "", "message": ""}, "elevated.status"),
        ("elevated", {"status": "value", "value": 1}, "elevated.value"),
        ("elevated", {"status": "value"}, "elevated.error"),
        ("machines", {"status": "value", "value": {}}, "machines.value"),
        ("machines/value/0/reserve", "10", "machines.value[0].reserve"),
        ("machines/value/0/reserve", None, "machines.value[0].reserve"),
        ("machines/value/0/colour", "red", "machines.value[0].colour"),
        ("machines/value/1/id", "1c7f29d8-5a10-4f6e-9a57-7f6d0c2b8e11", "machines.value"),
        ("journal", {"status": "denied"}, "journal.error"),
    ],
)
def test_foreign_output_is_refused_with_place(path: str, value: Any, where: str) -> None:
    with pytest.raises(NotDecodable) as refused:
        read_observation(changed(path, value))

    assert str(refused.value).startswith(f"{where}: ")


@pytest.mark.parametrize("data", [b"", b"\xff\xfe\0", b"\xff", b"[]", b"{}", b"powershell is not recognized", b"{" * 9])
def test_what_is_no_observation_is_refused(data: bytes) -> None:
    with pytest.raises(NotDecodable):
        read_observation(data)


def test_every_probe_is_read() -> None:
    from rarms_iac.powershell.templates import template_text

    text = template_text("observe.ps1.j2").split("$document = ")[1]
    probes = {
        line.split(" = ")[0].strip()
        for line in text.splitlines()
        if line.startswith("    ") and line[4] != " " and " = Get-Probe" in line
    }

    assert probes == set(HostObservation.__dataclass_fields__) - {"computer", "script_running"}


STRANGERS = "server-2022-with-strangers"
GROUP = "36ab08cb-3a76-4b38-992e-000000000002"


@pytest.mark.parametrize("name", NAMES)
def test_every_recorded_host_has_a_condition(name: str) -> None:
    seen = recorded(name)

    assert condition_of(seen).powershell is not None


def an_id() -> str:
    return to_state(recorded(STRANGERS), "cell").partitions[0].id


def cpu_group(seen: HostObservation) -> str:
    (found,) = [partition.cpu_group for partition in to_state(seen, "cell").partitions if partition.id == an_id()]
    return found


@pytest.mark.parametrize("group", [GROUP, GROUP.upper(), "{" + GROUP + "}"])
def test_group_of_machine_is_found_by_its_instance(group: str) -> None:
    setting = {"instance": f"Microsoft:{an_id().upper()}\\b637f346-6a0e-4dec-af52-bd70cb80a21d\\0", "group": group}
    seen = recorded(STRANGERS, cpu_groups=[{**setting, "reservation": 0}])

    assert cpu_group(seen) == GROUP


@pytest.mark.parametrize("group", ["", "00000000-0000-0000-0000-000000000000"])
def test_no_group_is_no_group(group: str) -> None:
    setting = {"instance": f"Microsoft:{an_id()}\\0", "group": group, "reservation": 0}

    assert cpu_group(recorded(STRANGERS, cpu_groups=[setting])) == ""


def test_policies_of_later_scopes_are_left_out() -> None:
    policies = [{"scope": "MachinePolicy", "policy": "AllSigned"}, {"scope": "Fleet", "policy": "Restricted"}]

    seen = recorded(STRANGERS, execution_policy=policies)

    assert condition_of(seen).policies == {PolicyScope.MACHINE_POLICY: "AllSigned"}


@pytest.mark.parametrize(("status", "message"), [("absent", "absent (Gone)"), ("denied", "denied (Gone)")])
def test_what_was_not_read_is_said_with_reason(status: str, message: str) -> None:
    found = condition_of(unread(STRANGERS, "cpu_groups", "numa", status=status))

    assert found.numa_nodes is None
    assert {name: found.unread[name] for name in ("the CPU groups", "the NUMA nodes")} == {
        "the CPU groups": message,
        "the NUMA nodes": message,
    }


def test_no_module_is_known_to_be_none() -> None:
    assert condition_of(recorded(STRANGERS, module=[])).module == ()


@pytest.mark.parametrize(
    ("index", "failure"), [("mean_response_time", "it ended with exit code 2"), ("success_rate", "")]
)
def test_exit_code_is_a_failure_without_success_rate(index: str, failure: str) -> None:
    component = a_component(apt={index: at_least(95) if index == "success_rate" else at_most(50)})
    work = Work(
        application="robot",
        partitions=(PartitionWork(partition="p1", components=(component,)),),
        until={"vision": SampleCount(samples=1)},
        seed=0,
    )
    seen = iter(
        json.dumps({"format": "rarms-seen/1", "setting": "1", "name": "vision", "seen": text, "at_ms": 9})
        for text in ("started 10000", "ended 10000 50000 2")
    )

    ((_, sample),) = GuestRun(next_line=lambda: next(seen), setting="1", work=work).samples()

    assert (sample.successful, sample.failure) == (False, failure)


def test_guest_skips_and_refuses_lines_that_host_does() -> None:
    samples = Samples(source="pattern", pattern="took (?P<t>[0-9.]+)", response_time=TimeField(field="t", unit="ms"))
    component = a_component(run=replace(run_of(a_component()), samples=samples, failures=9))
    work = Work(
        application="robot",
        partitions=(PartitionWork(partition="p1", components=(component,)),),
        until={"vision": SampleCount(samples=3)},
        seed=0,
    )
    seen = iter(
        json.dumps({"format": "rarms-seen/1", "setting": "1", "name": "vision", "seen": text, "at_ms": 9})
        for text in (
            "started 10000",
            "line 20000 loading",
            "ended 10000 50000 2",
            "started 10000",
            "line 20000 took 1.5e3",
            "line 30000 took 12ms",
        )
    )

    found = [sample for _, sample in GuestRun(next_line=lambda: next(seen), setting="1", work=work).samples()]

    assert [sample.failure for sample in found] == [
        'it ended with exit code 2; 1 line did not match the pattern ("loading")',
        'the field "t" reads "1.5", only a part of "1.5e3"',
        "",
    ]
    assert found[-1].response_ms == 12
