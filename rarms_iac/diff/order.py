"""The order in which the steps of all changes are done: the host never promises more than it has."""

from collections.abc import Sequence
from dataclasses import dataclass, field, replace

from rarms_iac.diff.disruption import grace_ms
from rarms_iac.diff.setting_steps import STARTS_AGAIN, StepBuilder, steps_of_start
from rarms_iac.diff.step_context import NO_CLAIM, StepContext, claim_of, within
from rarms_iac.diff.steps import PlannedChange, mark_moves
from rarms_iac.model.capacity import packs
from rarms_iac.model.changes import Change, Create, Delete, Update
from rarms_iac.model.claims import Claim, Load, load_of
from rarms_iac.model.diagnostics import Diagnostic
from rarms_iac.model.host import ProviderKind
from rarms_iac.model.operations import StartPartition, StopPartition
from rarms_iac.model.plan import Step, Undo, UndoLevel
from rarms_iac.model.state import Partition, RunState
from rarms_iac.model.system import Disruption
from rarms_iac.texts.findings import NO_ORDER
from rarms_iac.texts.plans import describe_stop


def order(planned: Sequence[PlannedChange], context: StepContext) -> tuple[Step, ...] | Diagnostic:
    """Put every step in one order; no prefix promises more than the host, or than what is promised already.

    First what gives back (removals, stops, smaller values), the least critical first; then what takes, the most
    critical first. Where every remaining step would take too much, the least critical running partition among those
    that wait is stopped first and started last. The cost is quadratic in the number of changes at worst.

    Args:
        planned: the changes of one host with their steps; the order of steps within a change is kept.
        context: what the host can promise, what it promises before the first step, and how much may be disturbed.

    Returns:
        Every step once, or the finding on a deadlock where `max_disruption` forbids the stop that would break it.
    """
    moves, rest = mark_moves(planned)
    on_host = [change for change in rest if not change.change.address.is_in_guest]
    walk = _Walk(context=context, queue=[list(change.steps) for change in on_host], plans=on_host)
    walk.done = list(moves)
    walk.run_releasing_steps()
    result = walk.run_the_rest()
    if isinstance(result, Diagnostic):
        return result
    # A guest's classes are written where it runs already: a real one cannot be reached before.
    in_guests = [planned for planned in rest if planned.change.address.is_in_guest]
    in_guests.sort(key=lambda planned: (planned.change.address.partition, planned.change.address.task))
    return (*result, *(step for planned in in_guests for step in planned.steps))


@dataclass(slots=True)
class _Walk:
    """The walk through all steps: those that are done, those that wait, and what is promised meanwhile."""

    context: StepContext
    queue: list[list[Step]]  # the remaining steps of each change
    plans: list[PlannedChange]
    done: list[Step] = field(default_factory=list)
    stopped: list[str] = field(default_factory=list)
    claims: dict[str, Claim] = field(default_factory=dict)  # of managed partitions, now
    start: Load = field(default_factory=Load)
    now: Load = field(default_factory=Load)
    packed_at_start: bool = True
    restarts: list[Step] = field(default_factory=list)  # of partitions that were stopped to make room

    def __post_init__(self) -> None:
        self.claims = {_machine_key(partition.id): claim_of(partition) for partition in self.context.seen.own}
        everything = (*self.context.seen.claims, *self.claims.values())
        self.start = self.now = load_of(everything)
        self.packed_at_start = packs(everything, self.context.seen.capacity)

    def run_releasing_steps(self) -> None:
        """Do each step that takes nothing, as far as each change's own order allows."""
        for at in sorted(range(len(self.queue)), key=self._releasing_first):
            steps = self.queue[at]
            while steps and steps[0].wait_ms is None and not steps[0].claim_before.is_less_than(steps[0].claim_after):
                self._do(steps.pop(0))

    def run_the_rest(self) -> tuple[Step, ...] | Diagnostic:
        """Return the other steps, as the context allows; and a stop where it does not."""
        while True:
            self._run_fitting_steps()
            waiting = [at for at in range(len(self.queue)) if self.queue[at]]
            if not waiting:
                break
            if (deadlock := self._stop_least_critical(waiting)) is not None:
                return deadlock
        for start in sorted(self.restarts, key=lambda step: self._most_critical_first(step.address.partition)):
            if not self._is_allowed(start):
                names = tuple(sorted(self.stopped))
                return _deadlock(names, self.context.max_disruption, may_stop=False)
            for step in self._steps_of_restart(start):
                self._do(step)
        return tuple(self.done)

    def _steps_of_restart(self, start: Step) -> tuple[Step, ...]:
        """Return the start of a partition that was stopped to make room, with more for its time where there is room."""
        change = next(each.change for each in self.plans if _machine_of(each.change) == start.address.machine)
        assert isinstance(change, Update)
        assert isinstance(change.after, Partition)
        off = replace(change.after, settings=replace(change.after.settings, running=False), state=RunState.OFF)
        builder = StepBuilder(address=start.address, now=off, reason=change.reason)
        more, *rest = steps_of_start(builder, self.context.starting.get(start.address.partition))
        claims = {**self.claims, _key(start): rest[0].claim_after if rest else start.claim_after}
        if not rest or not self.context.fits(claims.values()):
            return (start,)
        return (more, replace(start, claim_after=rest[0].claim_after), *rest[1:])

    def _run_fitting_steps(self) -> None:
        any_order = self._is_any_order_safe()
        progress = True
        while progress:
            progress = False
            for at in sorted(range(len(self.queue)), key=self._taking_first):
                while self.queue[at] and (any_order or self._is_allowed(self.queue[at][0])):
                    self._do(self.queue[at].pop(0))
                    progress = True

    def _is_any_order_safe(self) -> bool:
        """Return whether all remaining steps only grow towards an end that fits; then every prefix fits."""
        final = dict(self.claims)
        for steps in self.queue:
            for step in steps:
                final[_key(step)] = step.claim_after
        growing = all(within(step.claim_after, final[_key(step)]) for steps in self.queue for step in steps)
        unchanged = all(within(claim, final[key]) for key, claim in self.claims.items())
        return growing and unchanged and self.context.fits(final.values())

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

    def _is_allowed(self, step: Step) -> bool:
        if not step.claim_before.is_less_than(step.claim_after):
            return True
        load, capacity = self._load_after(step), self.context.seen.capacity
        if load.percent > 100 * capacity.processors and load.percent > self.start.percent:
            return False
        if load.memory > capacity.memory and load.memory > self.start.memory:
            return False
        claims = {**self.claims, _key(step): step.claim_after}
        return not self.packed_at_start or packs((*self.context.seen.claims, *claims.values()), capacity)

    def _stop_least_critical(self, waiting: list[int]) -> Diagnostic | None:
        """Stop the least critical running partition that waits; the deadlock where there is none, or none may stop."""
        running = [at for at in waiting if self.claims.get(_key(self.queue[at][0]), NO_CLAIM) != NO_CLAIM]
        names = tuple(sorted({self.queue[at][0].address.partition for at in waiting}))
        if not running or Disruption.PARTITION_STOP.exceeds(self.context.max_disruption):
            return _deadlock(names, self.context.max_disruption, may_stop=bool(running))
        at = min(running, key=lambda at: self.context.rank(self.queue[at][0].address.partition))
        partition = self.queue[at][0].address.partition
        others = [name for name in names if name != partition]
        with_others = f" with {', '.join(others)}" if others else ""
        why = (
            f"no order of the steps{with_others} stays within the capacity of the host, and this partition is "
            "the least critical"
        )
        stop_and_start = stop_and_restart(
            self.queue[at], why, grace_ms(self.context.graces, partition), self.context.seen.facts.provider
        )
        self._do(stop_and_start.stop)
        self.queue[at] = list(stop_and_start.between)
        self.restarts += [stop_and_start.start] if stop_and_start.start else []
        self.stopped.append(partition)
        return None

    def _releasing_first(self, at: int) -> tuple[int, int, str, str]:
        change = self.plans[at].change
        return (_rank(change), *self.context.rank(change.address.partition), change.address.task)

    def _taking_first(self, at: int) -> tuple[int, str, str]:
        address = self.plans[at].change.address
        return (*self._most_critical_first(address.partition), address.task)

    def _most_critical_first(self, partition: str) -> tuple[int, str]:
        criticality, name = self.context.rank(partition)
        return -criticality, name


def _rank(change: Change) -> int:
    """Return a key that puts removals first, then changes, then what is made; task classes go with their partition."""
    if change.address.task or change.address.responsiveness:
        return 3
    match change:
        case Delete():
            return 0
        case Create():
            return 2
        case _:
            return 1


def _key(step: Step) -> str:
    address = step.address
    return _machine_key(address.machine) if address.machine and not address.task else f"name {address}"


def _machine_of(change: Change) -> str:
    return "" if change.address.task else change.address.machine


def _machine_key(machine: str) -> str:
    return f"id {machine}"


def _deadlock(names: tuple[str, ...], limit: Disruption, *, may_stop: bool) -> Diagnostic:
    if may_stop:
        why = f"one of them would have to stop for a while, but `max_disruption` is {limit.value}"
        advice = "Use `--max-disruption partition_stop`, or stop one of them by hand and plan again."
    else:
        why = "none of them runs, so none can be stopped to make room"
        advice = "Lower their reservations, or those of other machines on the host."
    return NO_ORDER.at(
        None,
        "The changes of {_join} depend on each other: {why}. Nothing is planned for this host.",
        advice,
        address=f"partition/{names[0]}" if names else "",
        partitions=names,
        max_disruption=limit.value,
        _join=", ".join(names),
        why=why,
    )


@dataclass(frozen=True, slots=True, kw_only=True)
class StopAndRestart:
    """The rest of a change with a stop before it; `start` brings the partition back, where it is to run."""

    stop: Step
    between: tuple[Step, ...]
    start: Step | None


def stop_and_restart(remaining: Sequence[Step], why: str, grace: int, provider: ProviderKind) -> StopAndRestart:
    """Put a stop before the remaining steps of a running partition, so that they claim nothing while they are done.

    Args:
        remaining: at least one step, all of one partition.
        grace: milliseconds that it has to end.
        provider: of its host.

    Returns:
        The stop, the steps with no claim on the host while they are done, and the start that takes their claim; no
        start where the partition is to stay off.
    """
    first = remaining[0]
    address, claim_after = first.address, remaining[-1].claim_after
    stop_it = StopPartition(partition=address.partition, grace_ms=grace, machine=address.machine)
    start_it = StartPartition(partition=address.partition, machine=address.machine)
    stop = Step(
        address=address,
        title=f"stop it, to make room ({describe_stop(grace, provider)})",
        operation=stop_it,
        before={"exists": True, "running": True, "state": RunState.RUNNING.value},
        after={"exists": True, "running": False, "state": RunState.OFF.value},
        undo=Undo(level=UndoLevel.PARTIAL, operation=start_it, message=STARTS_AGAIN),
        disruption=Disruption.PARTITION_STOP,
        claim_before=first.claim_before,
        claim_after=NO_CLAIM,
        comment=why,
        place=first.place,
    )
    between = tuple(
        replace(step, claim_before=NO_CLAIM, claim_after=NO_CLAIM)
        for step in remaining
        if not isinstance(step.operation, StopPartition | StartPartition) and step.wait_ms is None
    )
    if claim_after == NO_CLAIM:
        return StopAndRestart(stop=stop, between=between, start=None)
    start = replace(
        stop,
        title="start it again",
        operation=start_it,
        before=stop.after,
        after=stop.before,
        undo=Undo(level=UndoLevel.FULL, operation=stop_it),
        disruption=Disruption.LIVE,
        claim_before=NO_CLAIM,
        claim_after=claim_after,
        comment="it was stopped only to make room",
    )
    return StopAndRestart(stop=stop, between=between, start=start)
