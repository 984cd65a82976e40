from rarms_iac.measuring.partitions import (
    HostBudget,
    highest_reserve,
    host_budget,
    memory_for_load,
    other_running_partitions,
    reserve_for_load,
)
from rarms_iac.model.measurement import EnvironmentSetup
from rarms_iac.model.state import RunState, State
from tests.builders import a_host, memory
from tests.builders_plan import facts, partition, settings

MIB = 2**20


def a_setup(*, processors: int = 2, ram: str = "512 MiB", limit: int = 100) -> EnvironmentSetup:
    return EnvironmentSetup(
        members=("vision",),
        interference="busy-loop",
        processors=processors,
        memory=memory(ram),
        limit=limit,
        weight=100,
    )


def the_room(*partitions: object, keep_processor: str = "0 %", keep_memory: str = "0 B") -> HostBudget:
    state = State(facts=facts(), partitions=partitions)  # type: ignore[arg-type]  # partitions, said by each test
    return host_budget(a_host(keep_processor=keep_processor, keep_memory=keep_memory), state, "robot")


def test_on_an_empty_host_p2_reserves_what_p1_does_not() -> None:
    room = the_room()

    assert [reserve_for_load(room, a_setup(), reserve) for reserve in (10, 62, 100)] == [90, 38, 0]
    assert room.unreserved
    assert highest_reserve(room, a_setup()) == 100


def test_what_is_kept_for_the_host_is_given_to_neither() -> None:
    room = the_room(keep_processor="10 %")

    assert reserve_for_load(room, a_setup(), 10) == 80
    assert reserve_for_load(room, a_setup(), 91) is None
    assert highest_reserve(room, a_setup()) == 90
    assert not room.unreserved


def test_what_strangers_reserve_is_given_to_neither() -> None:
    stranger = partition(settings("theirs", reserve=25, running=True), application=None)
    room = the_room(stranger)

    assert reserve_for_load(room, a_setup(), 50) == 25
    assert highest_reserve(room, a_setup()) == 75


def test_a_narrow_p1_leaves_p2_what_is_left_on_the_processor_that_both_use() -> None:
    assert reserve_for_load(the_room(), a_setup(processors=1), 30) == 70


def test_a_limit_is_the_highest_cr() -> None:
    assert highest_reserve(the_room(), a_setup(limit=60)) == 60


def test_p2_takes_the_memory_that_is_left_and_none_is_too_little() -> None:
    room = the_room(keep_memory="1 GiB")

    assert memory_for_load(room, a_setup()) == 512 * MIB
    assert memory_for_load(room, a_setup(ram="2944 MiB")) == 128 * MIB
    assert highest_reserve(room, a_setup(ram="3072 MiB")) == 0


def test_whatever_runs_is_in_the_way_and_test_partitions_are_not() -> None:
    ours = partition(settings("vision", running=True))
    strangers = partition(settings("a-game", running=True), application=None)
    off = partition(settings("speech", running=False))
    left = partition(settings("rarms-p1", running=True))
    pending = partition(settings("rarms-p2.rarms-000000000000", running=False), application=None)
    state = State(facts=facts(), partitions=(ours, strangers, off, left, pending))

    assert [partition.settings.name for partition in other_running_partitions(state)] == ["a-game", "vision"]
    assert host_budget(a_host(), state, "robot").others != ()
    assert {partition.state for partition in other_running_partitions(state)} == {RunState.RUNNING}
