"""What a host can give to P1 and P2, and what is in the way of measuring on it. Pure."""

from dataclasses import dataclass

from rarms_iac.model.capacity import WHOLE, Capacity, capacity_of, claim_of_settings, fits
from rarms_iac.model.measurement import TEST_PARTITIONS, EnvironmentSetup
from rarms_iac.model.plan import Claim
from rarms_iac.model.state import Partition, RunState, State
from rarms_iac.model.system import Host

USUAL_LOAD_MEMORY = 512 * 2**20
"""Bytes that P2 has, as in the paper's Table 1; less where the host has less left."""

LEAST_MEMORY = 32 * 2**20
"""Bytes below which no operating system starts: what Hyper-V demands of a machine (FACTS 1.3)."""

MEBIBYTE = 2**20

_AT_REST = {RunState.OFF, RunState.SAVED}


@dataclass(frozen=True, slots=True, kw_only=True)
class Room:
    """What a host has to give, and what of it is promised already."""

    capacity: Capacity
    others: tuple[Claim, ...]  # of every machine that counts and is no test partition

    @property
    def unreserved(self) -> bool:
        """Whether P1 and P2 can have all of every logical processor between them, as CMCPUR takes for granted."""
        whole = self.capacity.processors == self.capacity.logical_processors
        return whole and not any(other.reserve and other.processors for other in self.others)


def room_of(host: Host, state: State, application: str) -> Room:
    """What this host has to give: partitions of the application count while they run, all others as always."""
    return Room(
        capacity=capacity_of(host, state.facts),
        others=tuple(
            claim_of_settings(partition.settings) for partition in state.partitions if _counts(partition, application)
        ),
    )


def in_the_way(state: State) -> tuple[Partition, ...]:
    """What would run beside P1 and P2 and change what is measured, by name: everything that is not at rest."""
    running = [
        partition
        for partition in state.partitions
        if not is_test_partition(partition) and partition.state not in _AT_REST
    ]
    return tuple(sorted(running, key=lambda partition: (called(partition), partition.id)))


def called(partition: Partition) -> str:
    """What people call it: the name of its mark where it has one."""
    return partition.mark.name if partition.mark else partition.settings.name


def is_test_partition(partition: Partition) -> bool:
    """Whether it is a P1 or P2, finished or still under its pending name."""
    if partition.mark is not None:
        return partition.mark.name in TEST_PARTITIONS
    return any(partition.settings.name.startswith(f"{name}.") for name in TEST_PARTITIONS)


def load_memory(room: Room, setup: EnvironmentSetup) -> int:
    """Bytes that P2 gets beside P1: the usual, or what is left where that is less."""
    return left_memory(room, setup.memory)


def left_memory(room: Room, taken: int = 0) -> int:
    """Bytes for a P2: the usual, or what is left where that is less; whole MiB."""
    left = room.capacity.memory - sum(other.memory for other in room.others) - taken
    return min(USUAL_LOAD_MEMORY, left // MEBIBYTE * MEBIBYTE)


def reserve_beside(room: Room, setup: EnvironmentSetup, reserve: int) -> int | None:
    """What P2 reserves while P1 reserves this: the most that the host can still give, so 100 - CR on an empty one.

    Both are whole per cent of each of the partition's own processors. None: the host cannot give P1 so much.
    """
    p1 = Claim(processors=setup.processors, reserve=reserve, memory=setup.memory)
    return _most_of_p2(room, (p1,), load_memory(room, setup))


def left_beside(room: Room, memory: int) -> int:
    """What a P2 alone can reserve beside what is promised already; 0 where nothing is left."""
    return _most_of_p2(room, (), memory) or 0


def _most_of_p2(room: Room, others: tuple[Claim, ...], memory: int) -> int | None:
    wide = room.capacity.logical_processors
    for reserve in range(WHOLE, -1, -1):
        p2 = Claim(processors=wide, reserve=reserve, memory=max(0, memory))
        if fits(room.capacity, (*room.others, *others, p2)):
            return reserve
    return None


def most(room: Room, setup: EnvironmentSetup) -> int:
    """The highest CR that the host can give to P1; 0 where it can give none."""
    if load_memory(room, setup) < LEAST_MEMORY:
        return 0
    possible = range(min(WHOLE, setup.limit), 0, -1)
    return next((reserve for reserve in possible if reserve_beside(room, setup, reserve) is not None), 0)


def _counts(partition: Partition, application: str) -> bool:
    if is_test_partition(partition):
        return False
    if partition.mark is not None and partition.mark.application == application:
        return partition.state not in _AT_REST
    return partition.claims_resources
