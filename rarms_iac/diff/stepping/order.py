"""The order in which the steps of all changes are done: the host never promises more than it has (DESIGN section 4)."""

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, field, replace

from rarms_iac.diff import findings
from rarms_iac.diff.claims import claim_of, grows, within
from rarms_iac.diff.disruption import grace_ms
from rarms_iac.diff.stepping.exchange import mark_moves
from rarms_iac.diff.stepping.pause import pause_steps
from rarms_iac.diff.stepping.steps import Planned
from rarms_iac.model.capacity import Capacity, Load, fits, load_of, packs
from rarms_iac.model.changes import Change, Create, Delete, Update
from rarms_iac.model.diagnostics import Diagnostic
from rarms_iac.model.plan import Claim, Step
from rarms_iac.model.quantities import Milliseconds
from rarms_iac.model.state import Partition, State
from rarms_iac.model.system import Disruption


@dataclass(frozen=True, slots=True, kw_only=True)
class Ordered:
    """All steps of a host in the order in which they are done."""

    steps: tuple[Step, ...]
    stopped: tuple[str, ...] = ()  # partitions that are stopped for a while, only to make room


@dataclass(frozen=True, slots=True, kw_only=True)
class Cycle:
    """Steps that wait for each other: each needs what another holds."""

    partitions: tuple[str, ...]
    finding: Diagnostic


@dataclass(frozen=True, slots=True, kw_only=True)
class Room:
    """What the steps have to share."""

    capacity: Capacity
    foreign: tuple[Claim, ...] = ()  # of machines that are not ours
    ours: Mapping[str, Partition] = field(default_factory=dict)  # by machine id, before the first step
    criticality: Mapping[str, int] = field(default_factory=dict)  # by partition
    max_disruption: Disruption = Disruption.HOST_RESTART
    graces: Mapping[str, Milliseconds] = field(default_factory=dict)  # by partition: for its guest to shut down


def room_of(
    observed: State,
    application: str,
    capacity: Capacity,
    foreign: Iterable[Claim],
    *,
    criticality: Mapping[str, int],
    max_disruption: Disruption,
    graces: Mapping[str, Milliseconds],
) -> Room:
    """The room on a host: its capacity, less what others hold, with what ours hold now."""
    ours = {partition.id: partition for partition in observed.of(application).partitions}
    return Room(
        capacity=capacity,
        foreign=tuple(foreign),
        ours=ours,
        criticality=criticality,
        max_disruption=max_disruption,
        graces=graces,
    )


def order(planned: Sequence[Planned], room: Room) -> Ordered | Cycle:
    """Every step once, in-change order kept; no prefix promises more than the host, or than what is promised already.

    First what gives back (removals, stops, smaller values), the least critical first; then what takes, the most
    critical first. Where every step left would take too much, the least critical running partition among those that
    wait is stopped first and started last; where `max_disruption` forbids that, the answer is the cycle.
    """
    moves, rest = mark_moves(planned)
    on_host = [one for one in rest if not _in_guest(one.change)]
    walk = _Walk(room=room, queue=[list(one.steps) for one in on_host], plans=on_host)
    walk.done = list(moves)
    walk.run_freely()
    result = walk.fill()
    if isinstance(result, Cycle):
        return result
    # A guest's classes are written where it runs already: a real one cannot be reached before.
    inside = (step for one in sorted(rest, key=_by_address) if _in_guest(one.change) for step in one.steps)
    return replace(result, steps=(*result.steps, *inside))


def _in_guest(change: Change) -> bool:
    return bool(change.address.partition and change.address.task)


def _by_address(planned: Planned) -> tuple[str, str]:
    return planned.change.address.partition, planned.change.address.task


@dataclass(slots=True)
class _Walk:
    room: Room
    queue: list[list[Step]]  # what is left of each change
    plans: list[Planned]
    done: list[Step] = field(default_factory=list)
    stopped: list[str] = field(default_factory=list)
    claims: dict[str, Claim] = field(default_factory=dict)  # of ours, now
    start: Load = field(default_factory=Load)
    now: Load = field(default_factory=Load)
    packed_at_start: bool = True
    after_all: list[Step] = field(default_factory=list)  # starts of partitions that were stopped to make room

    def __post_init__(self) -> None:
        self.claims = {_key_of_machine(key): claim_of(partition) for key, partition in self.room.ours.items()}
        everything = (*self.room.foreign, *self.claims.values())
        self.start = self.now = load_of(everything)
        self.packed_at_start = packs(everything, self.room.capacity.logical_processors)

    def run_freely(self) -> None:
        """Everything that takes nothing, as far as each change's own order lets it."""
        for at in sorted(range(len(self.queue)), key=self._givers_first):
            self._run(at)

    def fill(self) -> Ordered | Cycle:
        """The rest, as the room allows; and a stop where it does not."""
        while True:
            self._take_what_fits()
            waiting = [at for at in range(len(self.queue)) if self.queue[at]]
            if not waiting:
                break
            if (cycle := self._make_room(waiting)) is not None:
                return cycle
        for start in sorted(self.after_all, key=lambda step: self._most_critical_first(step.address.partition)):
            if not self._allowed(start):
                names = tuple(sorted(self.stopped))
                return Cycle(partitions=names, finding=_cycle(names, self.room.max_disruption, may_stop=False))
            self._do(start)
        return Ordered(steps=tuple(self.done), stopped=tuple(self.stopped))

    def _take_what_fits(self) -> None:
        easy = self._end_is_safe()
        progress = True
        while progress:
            progress = False
            for at in sorted(range(len(self.queue)), key=self._takers_first):
                while self.queue[at] and (easy or self._allowed(self.queue[at][0])):
                    self._do(self.queue[at].pop(0))
                    progress = True

    def _end_is_safe(self) -> bool:
        """Whether all that is left only grows towards an end that fits; then every prefix fits, in any order."""
        final = dict(self.claims)
        for steps in self.queue:
            for step in steps:
                final[_key(step)] = step.claim_after
        growing = all(within(step.claim_after, final[_key(step)]) for steps in self.queue for step in steps)
        standing = all(within(claim, final[key]) for key, claim in self.claims.items())
        return growing and standing and fits(self.room.capacity, (*self.room.foreign, *final.values()))

    def _run(self, at: int) -> None:
        steps = self.queue[at]
        while steps and not grows(steps[0].claim_before, steps[0].claim_after):
            self._do(steps.pop(0))

    def _do(self, step: Step) -> None:
        self.now = self._load_after(step)
        self.claims[_key(step)] = step.claim_after
        self.done.append(step)

    def _load_after(self, step: Step) -> Load:
        old, new = step.claim_before, step.claim_after
        return Load(
            percent=self.now.percent - old.processors * old.reserve + new.processors * new.reserve,
            memory=self.now.memory - old.memory + new.memory,
        )

    def _allowed(self, step: Step) -> bool:
        if not grows(step.claim_before, step.claim_after):
            return True
        load, room = self._load_after(step), self.room.capacity
        if load.percent > 100 * room.processors and load.percent > self.start.percent:
            return False
        if load.memory > room.memory and load.memory > self.start.memory:
            return False
        claims = {**self.claims, _key(step): step.claim_after}
        return not self.packed_at_start or packs((*self.room.foreign, *claims.values()), room.logical_processors)

    def _make_room(self, waiting: list[int]) -> Cycle | None:
        """Stop the least critical running partition that waits; the cycle where there is none, or none may stop."""
        running = [at for at in waiting if self.claims.get(_key(self.queue[at][0]), Claim()) != Claim()]
        names = tuple(sorted({self.queue[at][0].address.partition for at in waiting}))
        if not running or Disruption.PARTITION_STOP.exceeds(self.room.max_disruption):
            return Cycle(partitions=names, finding=_cycle(names, self.room.max_disruption, may_stop=bool(running)))
        at = min(running, key=lambda one: self._weight(self.queue[one][0].address.partition))
        others = [name for name in names if name != self.queue[at][0].address.partition]
        grace = grace_ms(self.room.graces, self.queue[at][0].address.partition)
        pause = pause_steps(self.queue[at], self._why(others), grace)
        self._do(pause.stop)
        self.queue[at] = list(pause.between)
        self.after_all += [pause.start] if pause.start else []
        self.stopped.append(pause.stop.address.partition)
        return None

    @staticmethod
    def _why(others: list[str]) -> str:
        beside = f" beside {', '.join(others)}" if others else ""
        return f"no order of the steps{beside} keeps within the host, and it is the least critical of them"

    def _weight(self, partition: str) -> tuple[int, str]:
        return self.room.criticality.get(partition, 0), partition

    def _givers_first(self, at: int) -> tuple[int, int, str, str]:
        plan = self.plans[at]
        address = plan.change.address
        return (_rank(plan.change), *self._weight(address.partition), address.task)

    def _takers_first(self, at: int) -> tuple[int, str, str]:
        address = self.plans[at].change.address
        return (*self._most_critical_first(address.partition), address.task)

    def _most_critical_first(self, partition: str) -> tuple[int, str]:
        return -self.room.criticality.get(partition, 0), partition


def _rank(change: Change) -> int:
    """Removals before all, changes of what is there before what is made, task classes when their partition is."""
    if change.address.task or change.address.responsiveness:
        return 3
    match change:
        case Delete():
            return 0
        case Update():
            return 1
        case Create():
            return 2
        case _:
            return 1


def _key(step: Step) -> str:
    at = step.address
    return _key_of_machine(at.machine) if at.machine and not at.task else f"name {at}"


def _key_of_machine(machine: str) -> str:
    return f"id {machine}"


def _cycle(names: tuple[str, ...], limit: Disruption, *, may_stop: bool) -> Diagnostic:
    if may_stop:
        why = f"one of them would have to stop for a while, and `max_disruption` is {limit.value}"
        advice = "Allow `--max-disruption partition_stop`, or stop one of them by hand and plan again."
    else:
        why = "none of them runs, so none can be stopped to make room"
        advice = "Lower what they are to have, or what other machines on the host hold."
    return findings.NO_ORDER.at(
        None,
        f"The changes of {', '.join(names)} wait for each other: {why}. Nothing is planned for this host.",
        advice,
        address=f"partition/{names[0]}" if names else "",
    )
