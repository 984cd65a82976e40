"""P1 and P2 on a host: what each reserves, and what the load takes."""

from dataclasses import replace
from fractions import Fraction
from pathlib import Path

import pytest

from rarms_iac.measuring.evidence import disturbance
from rarms_iac.measuring.partitions import (
    LoadShare,
    MeasuringResources,
    highest_reserve,
    host_resources,
    load_shapes,
    load_share,
    memory_for_load,
    other_running_partitions,
    parts_that_fit,
    processors_of_load,
    running_test_partitions,
    set_reserves,
    shapes_of_test_partitions,
    share_next_to_layout,
)
from rarms_iac.model.host import ProviderKind
from rarms_iac.model.loads import LOADS_WITHOUT_ENTRY, BusyLoop, Interference
from rarms_iac.model.setting import LOAD_PARTITIONS, P1, P2, EnvironmentSetup, SettingEvidence
from rarms_iac.model.state import RunState, State
from rarms_iac.providers.cgroups.definitions import slice_limit
from rarms_iac.providers.interface import HostRefused
from rarms_iac.providers.simulated.provider import SimulatedHostProvider
from tests.builders import a_host, memory
from tests.builders_plan import facts, partition, settings

SETUP = EnvironmentSetup(
    members=("vision",), interference="busy-loop", processors=1, memory=memory("512 MiB"), limit=80, weight=200
)
SHAPES = shapes_of_test_partitions(SETUP, memory("256 MiB"), (2,))


def the_host(folder: Path) -> SimulatedHostProvider:
    return SimulatedHostProvider(a_host(), folder / "onboard.json")


def names(host: SimulatedHostProvider) -> list[str]:
    return [partition.settings.name for partition in host.observe().partitions]


def test_marked_test_partitions_run_during_context(tmp_path: Path) -> None:
    host = the_host(tmp_path)
    with running_test_partitions(host, "robot", SHAPES):
        p1, p2 = host.observe().partitions
        set_reserves(host, "robot", SHAPES, {P1: 30, P2: 70})
        set_reserves(host, "robot", SHAPES, {P1: 40, P2: 60})
        reserves = [partition.settings.reserve for partition in host.observe().partitions]

    assert [partition.mark and (partition.mark.application, partition.mark.name) for partition in (p1, p2)] == [
        ("robot", P1),
        ("robot", P2),
    ]
    assert (p1.settings.processors, p1.settings.limit, p1.settings.weight, p1.settings.memory) == (1, 80, 200, 2**29)
    assert (p2.settings.processors, p2.settings.limit, p2.settings.weight, p2.settings.memory) == (
        2,
        100,
        10_000,
        2**28,
    )
    assert p1.settings.running
    assert p2.settings.running
    assert reserves == [40, 60]
    assert names(host) == []


def test_measuring_partitions_go_when_work_fails(tmp_path: Path) -> None:
    host = the_host(tmp_path)
    with pytest.raises(KeyboardInterrupt), running_test_partitions(host, "robot", SHAPES):
        raise KeyboardInterrupt

    assert names(host) == []


def test_one_partition_goes_if_other_is_refused(tmp_path: Path) -> None:
    host = the_host(tmp_path)
    with (
        pytest.raises(HostRefused, match="needs"),
        running_test_partitions(host, "robot", (SHAPES[0], *load_shapes(memory("4 GiB"), (2,)))),
    ):
        raise AssertionError("P2 has no room")

    assert names(host) == []


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


def the_room(*partitions: object, keep_processor: str = "0 %", keep_memory: str = "0 B") -> MeasuringResources:
    state = State(facts=facts(), partitions=partitions)  # type: ignore[arg-type]  # partitions, said by each test
    return host_resources(a_host(keep_processor=keep_processor, keep_memory=keep_memory), state, "robot")


def reserve_of_load(room: MeasuringResources, reserve: int, processors: int = 2) -> int:
    share = load_share(room, a_setup(processors=processors), reserve, (2,))
    assert share is not None
    return share.reserve


def test_p2_reserves_the_rest_of_empty_host() -> None:
    room = the_room()

    assert [reserve_of_load(room, reserve) for reserve in (10, 62, 100)] == [90, 38, 0]
    assert room.unreserved
    assert highest_reserve(room, a_setup()) == 100


def test_p2_gets_what_the_host_keeps() -> None:
    room = the_room(keep_processor="10 %")

    assert reserve_of_load(room, 10) == 90
    assert reserve_of_load(room, 90) == 10
    assert load_share(room, a_setup(), 91, (2,)) is None
    assert highest_reserve(room, a_setup()) == 90
    assert not room.unreserved


def shares(room: MeasuringResources, load: Interference, reserve: int, processors: int) -> dict[str, int]:
    setup = a_setup(processors=processors)
    share = load_share(room, setup, reserve, processors_of_load(room, setup, load, 3))
    assert share is not None
    return dict(share.reserves)


BURSTS = LOADS_WITHOUT_ENTRY["bursts-20"]
SECOND = LOAD_PARTITIONS[1]


def test_last_part_reserves_processors_that_p1_has_no_vp_on() -> None:
    """P1 has one of two: P2 can reserve no more of each LP than P1 leaves of its own."""
    room = the_room()

    assert processors_of_load(room, a_setup(processors=1), BURSTS, 2) == (2, 1)
    assert processors_of_load(room, a_setup(processors=1), BusyLoop(), 2) == (2, 1), "without memory for three"
    assert shares(room, BURSTS, 48, processors=1) == {P2: 52, SECOND: 48}
    assert shares(room, BusyLoop(), 49, processors=1) == {P2: 26, SECOND: 25, LOAD_PARTITIONS[2]: 49}
    share = load_share(room, a_setup(processors=1), 48, (2, 1))
    assert share is not None
    assert (share.processors, share.others) == (Fraction(152, 100), Fraction(48, 100))


def test_parts_divide_the_rest_where_p1_has_every_processor() -> None:
    room = the_room()

    assert shares(room, BusyLoop(), 47, processors=2) == {P2: 27, SECOND: 26}
    assert shares(room, BURSTS, 47, processors=2) == {P2: 53}


def test_load_next_to_layout_reserves_processors_without_a_partition() -> None:
    alone = the_room(partition(settings("eyes", reserve=48, processors=1, running=True)))
    everywhere = the_room(partition(settings("eyes", reserve=48, processors=2, running=True)))

    for room, parts, reserves in (
        (alone, (2, 1), {P2: 52, SECOND: 48}),
        (everywhere, (2,), {P2: 52}),
    ):
        found, share = share_next_to_layout(room, BURSTS, 0, 2)
        assert (found, share.reserves) == (parts, reserves)


@pytest.mark.parametrize(("provider", "parts"), [(ProviderKind.LINUX, 3), (ProviderKind.SIMULATED, 2)])
def test_parts_of_load_need_less_memory_in_control_groups(provider: ProviderKind, parts: int) -> None:
    room = host_resources(replace(a_host(), provider=provider), State(facts=facts(), partitions=()), "robot")

    assert parts_that_fit(room, 3, taken=memory("3 GiB")) == parts


def test_a_linux_load_gets_what_the_slice_leaves() -> None:
    """Of 2 LPs 10 % are kept: partitions use 1.8 LP together, and a P1 of 0.2 LP leaves 1.6 to the load."""
    host = replace(a_host(keep_processor="10 %"), provider=ProviderKind.LINUX)
    room = host_resources(host, State(facts=facts(), partitions=()), "robot")

    small = load_share(room, a_setup(), 10, (2,))

    assert small == LoadShare(reserve=80, reserves={P2: 80}, processors=Fraction(8, 5), others=Fraction(1, 5))
    assert slice_limit(host, 2) == 180
    undisturbed = SettingEvidence(elapsed_ms=1000.0, cpu_ms={P1: 190.0, P2: 1590.0})
    assert disturbance(undisturbed, 2, small) == ""
    assert disturbance(replace(undisturbed, cpu_ms={P1: 190.0, P2: 1400.0}), 2, small).startswith("the load in P2")


def test_what_strangers_reserve_is_given_to_neither() -> None:
    stranger = partition(settings("theirs", reserve=25, running=True), application=None)
    room = the_room(stranger)

    assert reserve_of_load(room, 50) == 25
    assert highest_reserve(room, a_setup()) == 75


def test_narrow_p1_leaves_p2_the_rest() -> None:
    assert reserve_of_load(the_room(), 30, processors=1) == 70


def test_a_limit_is_the_highest_cr() -> None:
    assert highest_reserve(the_room(), a_setup(limit=60)) == 60


def test_p2_takes_left_memory_or_fails() -> None:
    room = the_room(keep_memory="1 GiB")

    assert memory_for_load(room, a_setup()) == 512 * MIB
    assert memory_for_load(room, a_setup(ram="2944 MiB")) == 128 * MIB
    assert highest_reserve(room, a_setup(ram="3072 MiB")) == 0


def test_p2_of_linux_takes_all_memory() -> None:
    host = a_host(provider=ProviderKind.LINUX)
    resources = host_resources(host, State(facts=facts(), partitions=()), "robot")

    assert memory_for_load(resources, a_setup(ram="1 GiB")) == resources.capacity.memory - 1024 * MIB


def test_running_machines_block_and_test_partitions_not() -> None:
    ours = partition(settings("vision", running=True))
    strangers = partition(settings("a-game", running=True), application=None)
    off = partition(settings("speech", running=False))
    left = partition(settings("rarms-p1", running=True))
    pending = partition(settings("rarms-p2.rarms-000000000000", running=False), application=None)
    state = State(facts=facts(), partitions=(ours, strangers, off, left, pending))

    assert [partition.settings.name for partition in other_running_partitions(state)] == ["a-game", "vision"]
    assert host_resources(a_host(), state, "robot").claims != ()
    assert {partition.state for partition in other_running_partitions(state)} == {RunState.RUNNING}
