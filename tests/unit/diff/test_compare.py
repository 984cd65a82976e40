from dataclasses import replace

import pytest

from rarms_iac.diff.compare import Difference, compare
from rarms_iac.diff.comparison import ManifestRules
from rarms_iac.diff.disruption import HostContext
from rarms_iac.model.changes import Create, Delete, Update
from rarms_iac.model.state import Partition, RegistryValue, RunState, State, TaskClass, TaskRecord, ValueKind
from rarms_iac.model.system import Disruption, RunsOn, StartMode, System
from rarms_iac.planner.desired import desired_state
from tests import builders_plan as build
from tests.builders import a_component, a_host, a_partition, a_system, a_task, codes
from tests.planning import PLACES, layout_of, route
from tests.pure_host import PureHost
from tests.strategies import Strangers, empty_state, facts_for, some_settings

HOST = a_host()


def robot(**kinds: object) -> System:
    return a_system(hosts=[HOST], **kinds)  # type: ignore[arg-type]  # what a_system takes


def applied(system: System, state: State | None = None) -> State:
    start = state or empty_state(HOST)
    host = PureHost(start, made=len(start.partitions))
    found = route(system, host.state)
    host.walk(found.ordered.steps)  # type: ignore[union-attr]  # these tests have no cycles
    return host.state


def difference(system: System, state: State) -> Difference:
    return route(system, state).difference


def edited(state: State, name: str, **changes: object) -> State:
    """The state after somebody changed a machine's settings by hand."""
    return replace(
        state,
        partitions=tuple(
            replace(partition, settings=replace(partition.settings, **changes))  # type: ignore[arg-type]
            if partition.settings.name == name
            else partition
            for partition in state.partitions
        ),
    )


def test_what_is_not_there_is_created_with_its_manifest_line() -> None:
    found = difference(robot(), empty_state(HOST))

    assert [type(change) for change in found.changes] == [Create]
    place = found.changes[0].reason.place
    assert place is not None
    assert place.path == "components.vision"


def test_a_value_changed_by_hand_is_set_back_live() -> None:
    state = edited(applied(robot()), "vision", reserve=5)

    (change,) = difference(robot(), state).changes

    assert isinstance(change, Update)
    assert change.disruption is Disruption.LIVE


def test_another_number_of_processors_stops_a_running_partition_only() -> None:
    more = robot(components=[a_component(processors=1)])
    state = applied(robot())

    assert [change.disruption for change in difference(more, state).changes] == [Disruption.PARTITION_STOP]

    off = edited(state, "vision", running=False)
    assert [change.disruption for change in difference(more, off).changes] == [Disruption.LIVE]


def test_memory_is_live_only_where_host_and_guest_are_known_to_be_new_enough() -> None:
    more = robot(components=[a_component(memory="1 GiB")])
    state = applied(robot())

    assert route(more, state, guest_build=26100).difference.changes[0].disruption is Disruption.LIVE
    assert route(more, state, guest_build=0).difference.changes[0].disruption is Disruption.PARTITION_STOP
    old = replace(state, facts=replace(state.facts, os_build=9600))
    assert route(more, old, guest_build=26100).difference.changes[0].disruption is Disruption.PARTITION_STOP


def test_another_generation_means_to_make_it_again() -> None:
    state = edited(applied(robot()), "vision", generation=1)

    assert [change.disruption for change in difference(robot(), state).changes] == [Disruption.REMOVAL]


def test_a_partition_the_manifest_no_longer_wants_is_stopped_once_and_then_only_listed() -> None:
    both = robot(components=[a_component(), a_component("speech")])
    state = applied(both)

    (change,) = difference(robot(), state).changes
    assert isinstance(change, Update)
    assert not change.after.settings.running  # type: ignore[union-attr]  # a partition

    found = difference(robot(), applied(robot(), state))
    assert found.changes == ()
    assert found.unused == ("speech",)


def test_moved_renames_instead_of_replacing() -> None:
    state = applied(robot())
    renamed = robot(components=[a_component("sight")], moved={"vision": "sight"})

    (change,) = difference(renamed, state).changes

    assert isinstance(change, Update)
    after = applied(renamed, state)
    assert [(partition.id, partition.settings.name) for partition in after.partitions] == [
        (state.partitions[0].id, "sight")
    ]
    assert difference(renamed, after).changes == ()


def test_two_partitions_exchange_names_without_two_marks_of_one_name() -> None:
    both = robot(components=[a_component(memory="1 GiB"), a_component("speech", memory="512 MiB")])
    state = applied(both)
    exchanged = replace(both, moved={"vision": "speech", "speech": "vision"})

    after = applied(exchanged, state)  # the pure host fails where a mark stands on two machines

    ids = {partition.settings.name: partition.id for partition in state.partitions}
    assert {partition.settings.name: partition.id for partition in after.partitions} == {
        "vision": ids["speech"],
        "speech": ids["vision"],
    }


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


def test_a_move_onto_a_partition_that_stays_is_told_and_not_done() -> None:
    both = robot(components=[a_component(), a_component("speech")])
    state = applied(both)
    wrong = robot(components=[a_component("speech")], moved={"vision": "speech"})

    found = difference(wrong, state)

    assert codes(found.findings) == ["RARMS156"]
    assert [str(change.address) for change in found.changes] == ["partition/vision"]  # it is unused now


def test_a_strange_machine_of_a_wanted_name_is_told_and_left_alone() -> None:
    stranger = Partition(settings=some_settings("vision"), id="ffff0000-stranger")

    found = difference(robot(), empty_state(HOST, Strangers((stranger,), ())))

    assert found.changes == ()
    assert codes(found.findings) == ["RARMS150"]
    assert "rarms import vision --id ffff0000-stranger" in found.findings[0].advice


def test_a_mark_that_does_not_count_is_told() -> None:
    copy = Partition(settings=some_settings("copy"), id="ffff0000-copy", foreign_mark="it names another machine")

    found = difference(robot(), empty_state(HOST, Strangers((copy,), ())))

    assert codes(found.findings) == ["RARMS151"]
    assert [str(change.address) for change in found.changes] == ["partition/vision"]


def test_a_protected_partition_is_not_removed() -> None:
    state = applied(robot(partitions=[a_partition(protect=True)]))
    context = HostContext(facts=facts_for(HOST))
    nothing = State(facts=facts_for(HOST))

    protected = compare(nothing, state, "robot", context, ManifestRules(protected=frozenset(["vision"])))
    assert (protected.changes, codes(protected.findings)) == ((), ["RARMS152"])

    gone = compare(nothing, state, "robot", context)
    assert [(type(change), change.disruption) for change in gone.changes] == [(Delete, Disruption.REMOVAL)]


def test_a_saved_machine_is_not_thrown_out_of_its_state() -> None:
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


def test_a_shipped_class_is_only_replaced_where_that_is_said_and_comes_back() -> None:
    watcher = a_component("watcher", runs_on=RunsOn.HOST, task="games")
    start = empty_state(HOST, Strangers((), (shipped("Games"),)))

    refused = difference(robot(components=[watcher]), start)
    assert (refused.changes, codes(refused.findings)) == ((), ["RARMS153"])

    allowed = robot(components=[watcher], tasks=[a_task("Games", replace_shipped=True)])
    after = applied(allowed, start)
    record = after.tasks[0].record
    assert record is not None
    assert record.before == shipped("Games").values
    assert difference(allowed, after).changes == ()

    assert applied(robot(), after).tasks == (shipped("Games"),)


def test_a_class_of_another_application_is_left_alone() -> None:
    theirs = replace(shipped("MotionControl"), record=TaskRecord(application="other", set="0" * 12, before=None))
    watcher = a_component("watcher", runs_on=RunsOn.HOST, task="MotionControl")

    found = difference(robot(components=[watcher]), empty_state(HOST, Strangers((), (theirs,))))

    assert (found.changes, codes(found.findings)) == ((), ["RARMS153"])


def test_a_partition_that_is_started_by_hand_may_run_or_not() -> None:
    by_hand = robot(partitions=[a_partition(start=StartMode.MANUAL)])
    state = applied(by_hand)
    assert not state.partitions[0].settings.running

    assert difference(by_hand, edited(state, "vision", running=True)).changes == ()


def test_the_other_state_is_not_of_this_application() -> None:
    state = applied(robot())
    layout = layout_of(robot(), state)
    other = replace(robot(), application=replace(robot().application, name="other"))

    found = desired_state(other, layout, state, PLACES)  # type: ignore[arg-type]  # it fits

    context = HostContext(facts=state.facts)
    assert codes(compare(found.state, state, "other", context).findings) == ["RARMS150"]


def test_a_shipped_class_of_a_guest_that_is_not_made_yet_waits_for_the_next_plan() -> None:
    system = robot(components=[a_component(task="Games")], tasks=[a_task("Games", replace_shipped=True)])

    first = difference(system, empty_state(HOST))
    assert [str(change.address) for change in first.changes] == ["partition/vision"]
    assert codes(first.findings) == ["RARMS157"]

    made = applied(system)
    guest = replace(shipped("Games"), inside="vision", machine=made.partitions[0].id)
    second = difference(system, replace(made, tasks=(guest,)))
    assert [str(change.address) for change in second.changes] == ["partition/vision/task/Games"]


def test_a_partition_of_another_generation_is_made_again_as_wanted() -> None:
    state = edited(applied(robot()), "vision", generation=1)

    after = applied(robot(), state)

    assert [(partition.settings.name, partition.settings.generation) for partition in after.partitions] == [
        ("vision", 2)
    ]
    assert after.partitions[0].id != state.partitions[0].id
    assert difference(robot(), after).changes == ()


ODD = [
    RegistryValue(kind=ValueKind.BINARY, data="1 2 255"),
    RegistryValue(kind=ValueKind.MULTI_SZ, data="a b"),
    RegistryValue(kind=ValueKind.EXPAND_SZ, data="C:\\Windows"),
    RegistryValue(kind=ValueKind.OTHER, data=""),
    RegistryValue(kind=ValueKind.QWORD, data=-1),
]


@pytest.mark.parametrize("odd", ODD, ids=lambda value: value.kind.value)
@pytest.mark.parametrize("place", ["there", "before rarms"])
def test_a_class_with_a_value_that_could_not_be_brought_back_is_left_alone(odd: RegistryValue, place: str) -> None:
    player = a_component("player", criticality=3, runs_on=RunsOn.HOST, task="Games")
    wanting = robot(components=[player], tasks=[a_task("Games", priority=4, replace_shipped=True)])
    games = build.task("Games", priority=2)
    values = {**games.values, "Extra": odd}
    record = TaskRecord(application="robot", set="b" * 12, before=values) if place == "before rarms" else None
    games = replace(games, values=games.values if record else values, record=record)
    state = replace(empty_state(HOST), tasks=(games,))

    found = difference(wanting, state)
    assert [change for change in found.changes if change.address.task] == []
    assert codes(found.findings) == ["RARMS165"]
    assert f'"Extra" ({odd.kind.value})' in found.findings[0].detail

    if record:
        gone = difference(robot(), state)
        assert ([change for change in gone.changes if change.address.task], codes(gone.findings)) == ([], ["RARMS165"])


@pytest.mark.parametrize(
    ("name", "why"),
    [
        *((name, "its name is a pattern") for name in ("a*", "Prior?ty", "x[1]", "a`b")),
        *((name, "the key's own value") for name in ("", "(default)", "(Default)")),
        ("PSObject", "PowerShell keeps its name"),
    ],
)
def test_a_value_whose_name_no_cmdlet_takes_is_left_alone_with_its_class(name: str, why: str) -> None:
    player = a_component("player", criticality=3, runs_on=RunsOn.HOST, task="Games")
    wanting = robot(components=[player], tasks=[a_task("Games", priority=4, replace_shipped=True)])
    games = build.task("Games", priority=2)
    games = replace(games, values={**games.values, name: RegistryValue(kind=ValueKind.DWORD, data=1)})

    found = difference(wanting, replace(empty_state(HOST), tasks=(games,)))

    assert [change for change in found.changes if change.address.task] == []
    assert codes(found.findings) == ["RARMS165"]
    assert f'"{name or "(Default)"}" ({why}' in found.findings[0].detail


def test_numbers_and_plain_text_can_be_brought_back() -> None:
    assert all(registry_value.is_restorable for registry_value in build.task().values.values())
    assert RegistryValue(kind=ValueKind.QWORD, data=2**40).is_restorable
