"""What can be read at an address, and which machine a name stands for."""

from dataclasses import replace

import pytest

from rarms_iac.diff.readings import NOTHING, readings, resolve
from rarms_iac.diff.step_context import Difference
from rarms_iac.model.changes import Address, Update
from rarms_iac.model.plan import Scope
from rarms_iac.model.state import Mark, Partition, RegistryValue, RunState, State, TaskClass, TaskRecord, ValueKind
from rarms_iac.model.system import Disruption, HypervPartition, RunsOn, StartMode, System
from tests import builders_plan as build
from tests.builders import a_component, a_host, a_partition, a_system, a_task, codes
from tests.builders_plan import facts, settings
from tests.planning import route
from tests.pure_host import PureHost
from tests.strategies import Strangers, empty_state

HOST = a_host()


def robot(**kinds: object) -> System:
    return a_system(hosts=[HOST], **kinds)  # type: ignore[arg-type]  # what a_system takes


def applied(system: System, state: State | None = None) -> State:
    start = state or empty_state(HOST)
    host = PureHost(start, made=len(start.partitions))
    found = route(system, host.state)
    host.walk(found.steps)
    return host.state


def difference(system: System, state: State) -> Difference:
    return route(system, state).difference


def edited(state: State, name: str, **changes: object) -> State:
    """The state after a person changed a machine's settings by hand."""
    return replace(
        state,
        partitions=tuple(
            replace(partition, settings=replace(partition.settings, **changes))  # type: ignore[arg-type]
            if partition.settings.name == name
            else partition
            for partition in state.partitions
        ),
    )


def test_another_number_of_processors_stops_running_partition_only() -> None:
    more = robot(components=[a_component(processors=1)])
    state = applied(robot())

    assert [change.disruption for change in difference(more, state).changes] == [Disruption.PARTITION_STOP]

    off = edited(state, "vision", running=False)
    assert [change.disruption for change in difference(more, off).changes] == [Disruption.LIVE]


def test_memory_is_live_only_on_new_versions() -> None:
    more = robot(components=[a_component(memory="1 GiB")])
    state = applied(robot())

    assert route(more, state, guest_build=26100).difference.changes[0].disruption is Disruption.LIVE
    assert route(more, state, guest_build=0).difference.changes[0].disruption is Disruption.PARTITION_STOP
    old = replace(state, facts=replace(state.facts, os_build=9600))
    assert route(more, old, guest_build=26100).difference.changes[0].disruption is Disruption.PARTITION_STOP


def test_three_partitions_pass_their_names_round() -> None:
    names = ("vision", "speech", "path")
    all_three = robot(components=[a_component(name) for name in names])
    state = applied(all_three)
    round_about = replace(all_three, moved=dict(zip(names, (*names[1:], names[0]), strict=True)))

    after = applied(round_about, state)

    ids = {partition.settings.name: partition.id for partition in state.partitions}
    assert {partition.settings.name: partition.id for partition in after.partitions} == {
        "speech": ids["vision"],
        "path": ids["speech"],
        "vision": ids["path"],
    }


def test_move_onto_existing_partition_is_told() -> None:
    both = robot(components=[a_component(), a_component("speech")])
    state = applied(both)
    wrong = robot(components=[a_component("speech")], moved={"vision": "speech"})

    found = difference(wrong, state)

    assert codes(found.findings) == ["RARMS156"]
    assert [str(change.address) for change in found.changes] == ["partition/vision"]  # it is unused now


def test_saved_machine_keeps_its_state() -> None:
    state = applied(robot())
    saved = replace(
        state,
        partitions=tuple(
            replace(partition, state=RunState.SAVED) for partition in edited(state, "vision", running=False).partitions
        ),
    )

    assert [type(change) for change in difference(robot(), saved).changes] == [Update]  # it is started again
    assert codes(difference(robot(components=[a_component(processors=1)]), saved).findings) == ["RARMS155"]
    by_hand = robot(components=[a_component(reserve="1 %")], partitions=[a_partition(start=StartMode.MANUAL)])
    assert codes(difference(by_hand, saved).findings) == ["RARMS155"]


def shipped(name: str) -> TaskClass:
    return TaskClass(name=name, values={"Priority": RegistryValue(kind=ValueKind.DWORD, data=2)})


def test_a_class_of_another_application_is_left_alone() -> None:
    theirs = replace(shipped("MotionControl"), record=TaskRecord(application="other", set="0" * 12, before=None))
    watcher = a_component("watcher", runs_on=RunsOn.HOST, task="MotionControl")

    found = difference(robot(components=[watcher]), empty_state(HOST, Strangers((), (theirs,))))

    assert (found.changes, codes(found.findings)) == ([], ["RARMS150"])


def test_manual_partition_may_run_or_not() -> None:
    by_hand = robot(partitions=[a_partition(start=StartMode.MANUAL)])
    state = applied(by_hand)
    assert not state.partitions[0].settings.running

    assert difference(by_hand, edited(state, "vision", running=True)).changes == []


def test_shipped_class_of_unmade_guest_waits() -> None:
    system = robot(components=[a_component(task="Games")], tasks=[a_task("Games", replace_shipped=True)])

    first = difference(system, empty_state(HOST))
    assert [str(change.address) for change in first.changes] == ["partition/vision"]
    assert codes(first.findings) == ["RARMS157"]

    made = applied(system)
    guest = replace(shipped("Games"), inside="vision", machine=made.partitions[0].id)
    second = difference(system, replace(made, tasks=(guest,)))
    assert [str(change.address) for change in second.changes] == ["partition/vision/task/Games"]


def test_other_generation_is_made_again() -> None:
    state = edited(applied(robot()), "vision", generation=1)

    after = applied(robot(), state)

    assert [(partition.settings.name, partition.settings.generation) for partition in after.partitions] == [
        ("vision", 2)
    ]
    assert after.partitions[0].id != state.partitions[0].id
    assert difference(robot(), after).changes == []


def test_machine_made_again_has_wanted_secure_boot() -> None:
    off = robot(partitions=[replace(a_partition("vision"), hyperv=HypervPartition(secure_boot="off"))])
    state = edited(applied(off), "vision", generation=1, secure_boot="")

    after = applied(off, state)

    assert [partition.settings.secure_boot for partition in after.partitions] == ["off"]
    assert difference(off, after).changes == []


ODD = [
    RegistryValue(kind=ValueKind.BINARY, data="1 2 255"),
    RegistryValue(kind=ValueKind.MULTI_SZ, data="a b"),
    RegistryValue(kind=ValueKind.EXPAND_SZ, data="C:\\Windows"),
    RegistryValue(kind=ValueKind.OTHER, data=""),
    RegistryValue(kind=ValueKind.QWORD, data=-1),
]


@pytest.mark.parametrize("odd", ODD, ids=lambda value: value.kind.value)
@pytest.mark.parametrize("place", ["there", "before rarms"])
def test_class_with_unrestorable_value_is_left_alone(odd: RegistryValue, place: str) -> None:
    player = a_component("player", criticality=3, runs_on=RunsOn.HOST, task="Games")
    wanting = robot(components=[player], tasks=[a_task("Games", priority=4, replace_shipped=True)])
    games = build.task("Games", priority=2)
    values = {**games.values, "Extra": odd}
    record = TaskRecord(application="robot", set="b" * 12, before=values) if place == "before rarms" else None
    games = replace(games, values=games.values if record else values, record=record)
    state = replace(empty_state(HOST), tasks=(games,))

    found = difference(wanting, state)
    assert [change for change in found.changes if change.address.task] == []
    assert codes(found.findings) == ["RARMS150"]
    assert f'"Extra" ({odd.kind.value})' in found.findings[0].detail

    if record:
        gone = difference(robot(), state)
        assert ([change for change in gone.changes if change.address.task], codes(gone.findings)) == ([], ["RARMS150"])


@pytest.mark.parametrize(
    ("name", "why"),
    [
        *((name, "PowerShell reads its name as a pattern") for name in ("a*", "Prior?ty", "x[1]", "a`b")),
        *((name, "the default value of the key") for name in ("", "(default)", "(Default)")),
        ("PSObject", "its name is reserved in PowerShell"),
    ],
)
def test_unwritable_value_keeps_its_class_alone(name: str, why: str) -> None:
    player = a_component("player", criticality=3, runs_on=RunsOn.HOST, task="Games")
    wanting = robot(components=[player], tasks=[a_task("Games", priority=4, replace_shipped=True)])
    games = build.task("Games", priority=2)
    games = replace(games, values={**games.values, name: RegistryValue(kind=ValueKind.DWORD, data=1)})

    found = difference(wanting, replace(empty_state(HOST), tasks=(games,)))

    assert [change for change in found.changes if change.address.task] == []
    assert codes(found.findings) == ["RARMS150"]
    assert f'"{name or "(Default)"}" ({why}' in found.findings[0].detail


SCOPE = Scope(application="robot", plan="0123456789ab")

FACTS = facts()
SETTINGS = settings()
MARK = Mark(application="robot", name="vision", machine="aaaaaaaa", set="0" * 12)
MANAGED = Partition(settings=SETTINGS, id="aaaaaaaa-1", state=RunState.RUNNING, mark=MARK)
STRANGER = Partition(settings=SETTINGS, id="bbbbbbbb-1", state=RunState.RUNNING)
VISION = Address(partition="vision")


def test_unmarked_namesake_is_not_read_as_ours() -> None:
    assert readings(State(facts=FACTS, partitions=(STRANGER,)), VISION, SCOPE) == NOTHING


def test_a_marked_machine_is_found_under_any_name() -> None:
    renamed = replace(MANAGED, settings=replace(SETTINGS, name="eyes"))

    found = readings(State(facts=FACTS, partitions=(STRANGER, renamed)), VISION, SCOPE)

    assert (found["name"], found["machine"], found["mark"]) == ("eyes", "aaaaaaaa-1", "robot/vision")


def test_the_mark_of_another_application_is_not_ours() -> None:
    other = replace(MANAGED, mark=replace(MARK, application="kiosk"))

    assert resolve((other,), "vision", SCOPE) == ()


def test_a_machine_that_this_plan_is_making_counts() -> None:
    pending = replace(STRANGER, settings=replace(SETTINGS, name="vision.rarms-0123456789ab"))
    of_another_plan = replace(STRANGER, settings=replace(SETTINGS, name="vision.rarms-ffffffffffff"))

    assert resolve((of_another_plan, pending), "vision", SCOPE) == (pending,)


def test_an_id_says_which_machine_is_meant() -> None:
    state = State(facts=FACTS, partitions=(MANAGED, STRANGER))

    found = readings(state, Address(partition="vision", machine="bbbbbbbb-1"), SCOPE)

    assert (found["machine"], found["mark"]) == ("bbbbbbbb-1", "")


def test_two_machines_for_one_name_satisfy_no_guard() -> None:
    pending = replace(STRANGER, settings=replace(SETTINGS, name="vision.rarms-0123456789ab"))

    assert readings(State(facts=FACTS, partitions=(MANAGED, pending)), VISION, SCOPE) == {"exists": True, "machines": 2}


def test_task_class_is_read_with_types() -> None:
    task = TaskClass(
        name="MotionControl",
        values={
            "Priority": RegistryValue(kind=ValueKind.SZ, data="6"),
            "Affinity": RegistryValue(kind=ValueKind.DWORD, data=0),
        },
        record=TaskRecord(application="robot", robot="robot-7", set="1" * 12, before=None),
    )

    found = readings(State(facts=FACTS, tasks=(task,)), Address(task="motioncontrol"), SCOPE)

    assert found == {
        "exists": True,
        "values": "affinity, priority",
        "value:Affinity": "dword:0",
        "value:Priority": "sz:6",
        "record": "robot",
        "robot": "robot-7",
        "set": "1" * 12,
    }


def test_a_record_without_its_key_is_read_too() -> None:
    task = TaskClass(name="MotionControl", record=TaskRecord(application="robot", set="1" * 12, before=None))

    found = readings(State(facts=FACTS, tasks=(task,)), Address(task="MotionControl"), SCOPE)

    assert found == {"exists": False, "values": "", "record": "robot", "robot": "", "set": "1" * 12}


def test_task_classes_of_guest_are_its_own() -> None:
    values = {"Priority": RegistryValue(kind=ValueKind.DWORD, data=5)}
    inside = TaskClass(name="Games", inside="vision", machine=MANAGED.id, values=values)
    state = State(facts=FACTS, partitions=(MANAGED,), tasks=(inside,))

    assert readings(state, Address(partition="vision", task="Games"), SCOPE)["exists"] is True
    assert readings(state, Address(task="Games"), SCOPE)["exists"] is False
    assert readings(replace(state, partitions=()), Address(partition="vision", task="Games"), SCOPE)["exists"] is False
