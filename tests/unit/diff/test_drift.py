"""Which parts of a host count as moved."""

from dataclasses import replace

import pytest

from rarms_iac.diff.drift import DriftKind, drift, moved_parts, part_digests
from rarms_iac.model.changes import Address, Create, Delete, Update
from rarms_iac.model.host import SchedulerType
from rarms_iac.model.operations import RemoveTaskClass, WriteTaskClass, WriteTaskRecord
from rarms_iac.model.state import (
    Mark,
    Partition,
    RegistryValue,
    Responsiveness,
    RunState,
    State,
    TaskClass,
    TaskRecord,
    ValueKind,
)
from rarms_iac.model.system import Disruption, System
from rarms_iac.views.changes import describe_disruption
from tests.builders import a_host, a_system, codes
from tests.builders_plan import facts, settings
from tests.planning import Route, route
from tests.pure_host import PureHost
from tests.strategies import empty_state

FACTS = facts()
SETTINGS = settings()
MANAGED = Partition(
    settings=SETTINGS,
    id="aaaa",
    state=RunState.RUNNING,
    mark=Mark(application="robot", name="vision", machine="aaaa", set="0" * 12),
)
THEIRS = Partition(settings=replace(SETTINGS, name="database", reserve=10), id="bbbb", state=RunState.RUNNING)
AUDIO = TaskClass(name="Audio", values={"Priority": RegistryValue(kind=ValueKind.DWORD, data=6)})
STATE = State(facts=FACTS, partitions=(THEIRS, MANAGED), tasks=(AUDIO,), serials={"robot": 3, "other": 9})


def moved(after: State) -> tuple[str, ...]:
    return moved_parts(part_digests(STATE, "robot"), part_digests(after, "robot"))


def test_unchanged_host_has_not_moved() -> None:
    assert moved(STATE) == ()


@pytest.mark.parametrize(
    ("after", "change"),
    [
        (replace(STATE, facts=replace(FACTS, logical_processors=4)), "the host itself has changed"),
        (replace(STATE, facts=replace(FACTS, scheduler=SchedulerType.ROOT)), "the host itself has changed"),
        (replace(STATE, serials={"robot": 4}), "the count of applies has changed"),
        (replace(STATE, partitions=(THEIRS,)), "partition/vision is gone"),
        (
            replace(STATE, partitions=(THEIRS, replace(MANAGED, settings=replace(SETTINGS, weight=99)))),
            "partition/vision has changed",
        ),
        (
            replace(STATE, partitions=(replace(THEIRS, settings=replace(THEIRS.settings, reserve=11)), MANAGED)),
            "machine database (bbbb) has changed",
        ),
        (replace(STATE, partitions=(MANAGED, THEIRS, replace(THEIRS, id="cccc"))), "machine database (cccc) is new"),
        (
            replace(STATE, tasks=(replace(AUDIO, values={"Priority": RegistryValue(kind=ValueKind.SZ, data="6")}),)),
            "task/Audio has changed",
        ),
    ],
)
def test_what_a_plan_rests_on_counts_as_moved(after: State, change: str) -> None:
    assert moved(after) == (change,)


def test_what_no_plan_rests_on_does_not_count() -> None:
    others = replace(THEIRS, other_notes="a note", settings=replace(THEIRS.settings, weight=7))

    assert moved(replace(STATE, partitions=(others, MANAGED), serials={"robot": 3, "other": 10})) == ()


ADDRESS = Address(responsiveness=True)


def dword(data: int) -> RegistryValue:
    return RegistryValue(kind=ValueKind.DWORD, data=data)


def writing(percent: int) -> WriteTaskClass:
    return WriteTaskClass(task="SystemResponsiveness", inside="", values={"SystemResponsiveness": dword(percent)})


def wanting(percent: int | None) -> System:
    return a_system(hosts=[a_host(system_responsiveness=percent)])


def a_state(there: Responsiveness | None) -> State:
    return replace(empty_state(a_host()), responsiveness=there)


def applied(system: System, state: State) -> State:
    host = PureHost(state, made=len(state.partitions))
    host.walk(route(system, state).steps)
    return host.state


def of_it(found: Route) -> list[object]:
    return [change for change in found.difference.changes if change.address == ADDRESS]


def test_windows_value_is_taken_over() -> None:
    found = route(wanting(10), a_state(Responsiveness(value=dword(20))))

    (change,) = of_it(found)
    assert isinstance(change, Update)
    assert change.disruption is Disruption.HOST_RESTART
    assert describe_disruption(change) == "when the host starts again"
    assert isinstance(change.after, Responsiveness)
    assert change.after.record is not None
    assert change.after.record.before == {"SystemResponsiveness": dword(20)}
    assert change.reason.place is not None
    assert change.reason.place.path == "hosts.onboard.system_responsiveness"
    steps = [step for step in found.steps if step.address == ADDRESS]
    assert [type(step.operation) for step in steps] == [WriteTaskRecord, WriteTaskClass]
    assert steps[1].title == "set SystemResponsiveness 20 -> 10"
    assert steps[1].undo.operation == writing(20)


def test_missing_value_is_created_and_undone() -> None:
    found = route(wanting(10), a_state(Responsiveness()))

    assert [type(change) for change in of_it(found)] == [Create]
    steps = [step for step in found.steps if step.address == ADDRESS]
    assert steps[1].undo.operation == RemoveTaskClass(task="SystemResponsiveness", inside="")


def test_responsiveness_without_manifest_line_goes_back() -> None:
    state = applied(wanting(10), a_state(Responsiveness(value=dword(20))))

    (change,) = of_it(route(wanting(None), state))

    assert isinstance(change, Delete)
    assert change.reason.message == "the manifest no longer sets it; 20 is restored"
    assert applied(wanting(None), state).responsiveness == Responsiveness(value=dword(20))


def test_without_the_line_a_value_of_others_stays() -> None:
    assert of_it(route(wanting(None), a_state(Responsiveness(value=dword(0))))) == []


def test_another_applications_value_and_unknown_one_are_refused() -> None:
    theirs = TaskRecord(application="kiosk", set="a" * 12, before=None)

    for there, message in (
        (Responsiveness(value=dword(20), record=theirs), 'application "kiosk" set it'),
        (None, "could not be read"),
    ):
        found = route(wanting(10), a_state(there))
        assert of_it(found) == []
        assert codes(found.difference.findings) == ["RARMS227"]
        assert message in found.difference.findings[0].detail


def test_drift_tells_who_changed_it() -> None:
    state = applied(wanting(10), a_state(Responsiveness(value=dword(20))))
    assert state.responsiveness is not None
    by_hand = replace(state, responsiveness=replace(state.responsiveness, value=dword(50)))

    def kinds(system: System, there: State) -> list[DriftKind]:
        drifts = drift(route(system, there).desired.state, there, "robot")
        return [drift_.drift for drift_ in drifts if drift_.address == ADDRESS]

    assert kinds(wanting(10), state) == []
    assert kinds(wanting(10), by_hand) == [DriftKind.HOST_CHANGED]
    assert kinds(wanting(30), state) == [DriftKind.NOT_APPLIED]
    assert kinds(wanting(None), state) == [DriftKind.NOT_APPLIED]
    assert kinds(wanting(30), by_hand) == [DriftKind.BOTH]
    assert kinds(wanting(10), a_state(Responsiveness())) == [DriftKind.MISSING]


def test_a_plan_is_stale_where_it_was_changed() -> None:
    before, after = (part_digests(a_state(Responsiveness(value=dword(data))), "robot") for data in (20, 30))

    assert moved_parts(before, after) == ("mmcss/responsiveness has changed",)


def test_unmarked_machine_is_not_called_missing() -> None:
    wanted = State(facts=FACTS, partitions=(MANAGED,))
    released = State(facts=FACTS, partitions=(replace(MANAGED, mark=None),))

    for last_run, kind in ((frozenset[str](), DriftKind.UNMANAGED), (frozenset({"vision"}), DriftKind.REMOVED)):
        (found,) = drift(wanted, released, "robot", last_run=last_run)
        assert found.drift is kind
