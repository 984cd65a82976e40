"""The steps of a partition's change.

Order within a change: stop, what gives back, what takes more, actions, name, mark, start. The mark comes after the
values, because a host that was left half-way must not look as if it had everything that was written.
"""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from fractions import Fraction
from math import ceil

from rarms_iac.diff.claims import NO_CLAIM, claim_of
from rarms_iac.diff.disruption import Surroundings, facets, grace_ms, needs_off
from rarms_iac.diff.readings import NOTHING, partition_readings
from rarms_iac.model.changes import Address, Reason
from rarms_iac.model.layout import Making
from rarms_iac.model.operations import (
    CreatePartition,
    EraseMark,
    Operation,
    RemoveDisk,
    RemovePartition,
    RenamePartition,
    SetActions,
    SetCpu,
    SetMemory,
    SetProcessors,
    StartPartition,
    StopPartition,
    WriteMark,
)
from rarms_iac.model.plan import Readings, Step, Undo, UndoLevel
from rarms_iac.model.quantities import plain, show_bytes, show_percent
from rarms_iac.model.state import Checkpoints, Disk, Facet, Mark, Partition, PartitionSettings, RunState
from rarms_iac.model.system import GRACE, Disruption

_STARTS_ANEW = "it starts anew: what its programs had in memory is lost"
_NOT_PAUSED_AGAIN = Undo(level=UndoLevel.NONE, operation=None, says="it was paused: it is not so again")
WITH_ITS_MACHINE = Undo(level=UndoLevel.FULL, operation=None, says="it goes with the machine, which is removed")


@dataclass(slots=True)
class _Machine:
    """Walks one machine through its steps: what is there now is the before of the next step."""

    address: Address
    now: Partition
    reason: Reason
    grace_ms: int = ceil(GRACE)  # for its guest to shut down
    new: bool = False  # made by this plan: its own undo removes it, and its first values are the host's affair

    def step(
        self,
        operation: Operation,
        back: Operation,
        after: Partition,
        names: tuple[str, ...],
        title: str,
        why: str,
        *,
        disruption: Disruption = Disruption.LIVE,
        lost: str = "",
    ) -> Step:
        before, self.now = self.now, after
        level = UndoLevel.PARTIAL if lost else UndoLevel.FULL
        return Step(
            address=self.address,
            title=title,
            operation=operation,
            before=_some(before, () if self.new else names),
            after=_some(after, names),
            undo=WITH_ITS_MACHINE if self.new else Undo(level=level, operation=back, says=lost),
            disruption=disruption,
            claim_before=claim_of(before),
            claim_after=claim_of(after),
            comment=f"{self.reason.says}; {why}" if self.reason.says else why,
            place=self.reason.place,
        )


def _some(partition: Partition, names: tuple[str, ...]) -> Readings:
    everything = partition_readings(partition)
    return {name: everything[name] for name in ("exists", *names)}


def create_partition(address: Address, after: Partition, reason: Reason, around: Surroundings) -> Iterator[Step]:
    """Make it under its pending name, mark it, set everything, rename it last, and start it."""
    wanted = after.settings
    making = around.making.get(address.partition, Making())
    yield _made(address, wanted, making, reason)
    pending = replace(after, settings=replace(wanted, running=False), state=RunState.OFF)
    grace = grace_ms(around.graces, address.partition)
    machine = _Machine(address=replace(address, machine=""), now=pending, reason=reason, grace_ms=grace, new=True)
    name = address.partition
    assert after.mark is not None, "what rarms makes, it marks"
    yield _mark(machine, after.mark, None, "from now on it is known as ours, whatever happens")
    for facet in (Facet.PROCESSORS, Facet.CPU, Facet.ACTIONS):
        yield from _set(machine, facet, wanted, wanted)
    yield machine.step(
        RenamePartition(partition=name, name=wanted.name),
        RenamePartition(partition=name, name=wanted.name),
        machine.now,
        ("name",),
        f"give it its name {wanted.name}",
        "last, so that a machine of this name is always whole",
    )
    if wanted.running:
        start = _start(machine)
        back = Undo(level=UndoLevel.FULL, operation=StopPartition(partition=name, grace_ms=grace))
        # What a new machine is made with is the host's affair, but it is off: to that its undo brings it back.
        yield replace(start, before={**start.before, "running": False, "state": RunState.OFF.value}, undo=back)


def _made(address: Address, wanted: PartitionSettings, making: Making, reason: Reason) -> Step:
    lost = f"the disk made from {making.image} stays" if making.image else ""
    return Step(
        address=replace(address, machine=""),
        title=f"make a machine of generation {wanted.generation} with {show_bytes(wanted.memory)}",
        operation=CreatePartition(
            partition=address.partition,
            generation=wanted.generation,
            memory=wanted.memory,
            image=making.image,
            switch=making.switch,
            vm_path=making.vm_path,
        ),
        before=NOTHING,
        after={"exists": True, "generation": wanted.generation, "memory": wanted.memory},
        undo=Undo(
            level=UndoLevel.PARTIAL if lost else UndoLevel.FULL,
            operation=RemovePartition(partition=address.partition),
            says=lost,
        ),
        disruption=Disruption.LIVE,
        claim_before=claim_of(None),
        claim_after=claim_of(None),
        comment=f"{reason.says}; off and under a pending name until all is set",
        place=reason.place,
    )


def update_partition(
    address: Address, before: Partition, after: Partition, reason: Reason, around: Surroundings
) -> Iterator[Step]:
    """Bring it to its wanted settings, stopping it only where something cannot change live and it runs."""
    changed = facets(before.settings, after.settings)
    if Facet.GENERATION in changed:
        yield from remove_partition(address, before, reason, replace(around, disks={}))
        yield from create_partition(replace(address, machine=""), after, reason, around)
        return
    grace = grace_ms(around.graces, address.partition)
    machine = _Machine(address=address, now=before, reason=reason, grace_ms=grace)
    off = needs_off(before.settings, after.settings, around)
    yield from moved(machine.address, before, reason)
    machine.now = _renamed_mark(before, address.partition)
    if before.settings.running and (off or not after.settings.running):
        yield _stop(machine, "it must be off for what follows" if after.settings.running else "it is not to run")
    for facet in sorted(changed & _VALUES, key=lambda one: (_takes_more(one, before, after), _ORDER.index(one))):
        yield from _set(machine, facet, before.settings, after.settings)
    if Facet.NAME in changed:
        yield _rename(machine, before.settings.name, after.settings.name)
    old = machine.now.mark
    if after.mark is not None and (old is None or old.set != after.mark.set):
        yield _mark(machine, after.mark, old, "the mark says what was last written")
    if after.settings.running and not machine.now.settings.running:
        yield _start(machine)


_ORDER = (Facet.PROCESSORS, Facet.CPU, Facet.MEMORY, Facet.ACTIONS)
_VALUES = frozenset(_ORDER)


def _takes_more(facet: Facet, before: Partition, after: Partition) -> bool:
    old, new = before.settings, after.settings
    match facet:
        case Facet.PROCESSORS:
            return new.processors > old.processors
        case Facet.CPU:
            return new.reserve > old.reserve
        case Facet.MEMORY:
            return new.memory > old.memory
        case _:
            return True  # actions weigh nothing; they come after the values


def moved(address: Address, before: Partition, reason: Reason, between: str = "") -> Iterator[Step]:
    """The step that gives the mark its new name, where the manifest moved it; `between` breaks an exchange."""
    name = between or address.partition
    mark = before.mark
    if mark is None or mark.name == name:
        return
    machine = _Machine(address=address, now=before, reason=reason)
    why = "two partitions change names: one steps aside" if between else "the manifest calls it so now"
    yield _mark(machine, replace(mark, name=name), mark, why)


def _renamed_mark(before: Partition, name: str) -> Partition:
    return replace(before, mark=replace(before.mark, name=name)) if before.mark else before


def remove_partition(address: Address, before: Partition, reason: Reason, around: Surroundings) -> Iterator[Step]:
    """Stop it where it runs or is paused, and remove it. Its disks are kept, unless they were asked for."""
    grace = grace_ms(around.graces, address.partition)
    machine = _Machine(address=address, now=before, reason=reason, grace_ms=grace)
    if before.state in {RunState.RUNNING, RunState.PAUSED}:
        yield _stop(machine, f"a {before.state.value} machine cannot be removed")
    going = around.disks.get(before.id, ())
    others = "keep its other disks" if going else "keep its disks"
    removal = Step(
        address=address,
        title=f"remove the machine, {others}",
        operation=RemovePartition(partition=address.partition, machine=address.machine),
        # Hyper-V merges checkpoints into the disk after the machine is gone: such a disk must not be deleted.
        before=_some(machine.now, ("machine", "state", *(("snapshots",) if going else ()))),
        after=NOTHING,
        undo=Undo(
            level=UndoLevel.NONE,
            operation=None,
            says="the machine is not made again" + ("" if going else "; its disks are still there"),
        ),
        disruption=Disruption.REMOVAL,
        claim_before=claim_of(machine.now),
        claim_after=claim_of(None),
        comment=f"{reason.says}; removed before anything is made, so that there is room",
        place=reason.place,
    )
    yield removal
    yield from (_disk_removed(removal, disk) for disk in going)


def _disk_removed(removal: Step, disk: Disk) -> Step:
    """After its machine, so that nothing has it any more; a run that was killed between the two goes on here."""
    return replace(
        removal,
        address=replace(removal.address, disk=disk.path),
        title=f"delete its disk {disk.path}",
        operation=RemoveDisk(partition=removal.address.partition, path=disk.path, parent=disk.parent),
        before={"exists": True, "parent": disk.parent, "used": False},
        undo=Undo(level=UndoLevel.NONE, operation=None, says="what is on the disk is lost"),
        claim_before=NO_CLAIM,
        claim_after=NO_CLAIM,
        comment="its removal was asked for; rarms made it, and it grows out of " + disk.parent,
    )


def take_in(address: Address, before: Partition, after: Partition, reason: Reason) -> Iterator[Step]:
    """Adopt: the mark, and nothing else."""
    assert after.mark is not None, "what rarms adopts, it marks"
    yield _mark(_Machine(address=address, now=before, reason=reason), after.mark, None, "only the mark is written")


def take_out(address: Address, before: Partition, reason: Reason) -> Iterator[Step]:
    """Release: the mark goes, the machine stays as it is."""
    mark = before.mark
    assert mark is not None, "only what is ours is released"
    machine = _Machine(address=address, now=before, reason=reason)
    yield machine.step(
        EraseMark(partition=address.partition, machine=address.machine),
        WriteMark(
            partition=address.partition,
            application=mark.application,
            name=mark.name,
            set=mark.set,
            machine=address.machine,
        ),
        replace(before, mark=None),
        ("mark", "set"),
        "erase the mark",
        "the machine stays as it is",
    )


def _mark(machine: _Machine, new: Mark, old: Mark | None, why: str) -> Step:
    at = machine.address
    marked = replace(machine.now, mark=replace(new, machine=machine.now.id[:8]))

    def write(mark: Mark) -> WriteMark:
        return WriteMark(
            partition=at.partition, application=mark.application, name=mark.name, set=mark.set, machine=at.machine
        )

    back = write(old) if old else EraseMark(partition=at.partition, machine=at.machine)
    title = f"mark it as {new.application}/{new.name}, set {new.set}"
    return machine.step(write(new), back, marked, ("mark", "set"), title, why)


def _set(machine: _Machine, facet: Facet, old: PartitionSettings, new: PartitionSettings) -> Iterator[Step]:
    """One call for one facet."""
    at, settings = machine.address, machine.now.settings
    match facet:
        case Facet.PROCESSORS:
            yield machine.step(
                SetProcessors(partition=at.partition, processors=new.processors, machine=at.machine),
                SetProcessors(partition=at.partition, processors=old.processors, machine=at.machine),
                replace(machine.now, settings=replace(settings, processors=new.processors)),
                ("processors", "state"),
                _title("processors", old.processors, new.processors, new=machine.new),
                "only while it is off",
            )
        case Facet.CPU:
            yield machine.step(
                _cpu(at, new),
                _cpu(at, old),
                replace(
                    machine.now,
                    settings=replace(settings, reserve=new.reserve, limit=new.limit, weight=new.weight),
                ),
                ("reserve", "limit", "weight"),
                _cpu_title(old, new, new=machine.new),
                _why_here(old.reserve, new.reserve, new=machine.new),
            )
        case Facet.MEMORY:
            yield machine.step(
                SetMemory(partition=at.partition, memory=new.memory, dynamic=new.dynamic_memory, machine=at.machine),
                SetMemory(partition=at.partition, memory=old.memory, dynamic=old.dynamic_memory, machine=at.machine),
                replace(
                    machine.now,
                    settings=replace(settings, memory=new.memory, dynamic_memory=new.dynamic_memory),
                ),
                ("memory", "dynamic_memory", *(("state",) if machine.now.state is RunState.OFF else ())),
                _title("memory", show_bytes(old.memory), show_bytes(new.memory), new=machine.new)
                + ("" if old.dynamic_memory == new.dynamic_memory else ", static"),
                _why_here(old.memory, new.memory, new=machine.new),
            )
        case Facet.ACTIONS:
            yield machine.step(
                _actions(at, new),
                _actions(at, old),
                replace(
                    machine.now,
                    settings=replace(
                        settings,
                        start_action=new.start_action,
                        stop_action=new.stop_action,
                        checkpoints=new.checkpoints,
                    ),
                ),
                ("start_action", "stop_action", "checkpoints"),
                _with_its_host(new),
                "what its host does with it",
            )
        case Facet.NAME | Facet.GENERATION:
            raise AssertionError("names and generations have steps of their own")


def _with_its_host(to: PartitionSettings) -> str:
    start, stop = to.start_action.value.replace("_", " "), to.stop_action.value.replace("_", " ")
    kept = "no" if to.checkpoints is Checkpoints.DISABLED else to.checkpoints.value.replace("_", " ")
    return f"when the host starts: {start}, when it stops: {stop}; {kept} checkpoints"


def _cpu(at: Address, to: PartitionSettings) -> SetCpu:
    return SetCpu(partition=at.partition, reserve=to.reserve, limit=to.limit, weight=to.weight, machine=at.machine)


def _actions(at: Address, to: PartitionSettings) -> SetActions:
    return SetActions(
        partition=at.partition,
        start=to.start_action,
        stop=to.stop_action,
        checkpoints=to.checkpoints,
        machine=at.machine,
    )


def _rename(machine: _Machine, old: str, new: str) -> Step:
    at = machine.address
    return machine.step(
        RenamePartition(partition=at.partition, name=new, machine=at.machine),
        RenamePartition(partition=at.partition, name=old, machine=at.machine),
        replace(machine.now, settings=replace(machine.now.settings, name=new)),
        ("name",),
        f"name {old} -> {new}",
        "its settings stay",
    )


def _stop(machine: _Machine, why: str) -> Step:
    """Read as running: a machine that was saved or paused since the plan is none that was stopped."""
    at, was_running = machine.address, machine.now.settings.running
    stop = machine.step(
        StopPartition(partition=at.partition, grace_ms=machine.grace_ms, machine=at.machine),
        StartPartition(partition=at.partition, machine=at.machine),
        replace(machine.now, settings=replace(machine.now.settings, running=False), state=RunState.OFF),
        ("running", "state"),
        f"stop it ({_asked(machine.grace_ms)})" if was_running else "turn it off",
        why,
        disruption=Disruption.PARTITION_STOP,
        lost=_STARTS_ANEW,
    )
    return stop if was_running else replace(stop, undo=_NOT_PAUSED_AGAIN)


def _asked(grace: int) -> str:
    return f"asked; after {plain(Fraction(grace, 1000))} s turned off" if grace else "turned off, not asked"


def _start(machine: _Machine) -> Step:
    at, was_off = machine.address, machine.now.state is RunState.OFF
    start = machine.step(
        StartPartition(partition=at.partition, machine=at.machine),
        StopPartition(partition=at.partition, grace_ms=machine.grace_ms, machine=at.machine),
        replace(machine.now, settings=replace(machine.now.settings, running=True), state=RunState.RUNNING),
        ("running", "state"),
        "start it",
        "after all that it is to have is set",
        lost="" if was_off else "it is turned off, not saved again",
    )
    # What was saved cannot be so again: its undo leaves it off, and asks no more than that.
    return start if was_off else replace(start, before={"exists": True, "running": False})


def _title(word: str, old: object, new_value: object, *, new: bool) -> str:
    return f"{word} {new_value}" if new else f"{word} {old} -> {new_value}"


def _cpu_title(old: PartitionSettings, to: PartitionSettings, *, new: bool) -> str:
    words = []
    for word in ("reserve", "limit"):
        before, after = getattr(old, word), getattr(to, word)
        if new:
            words.append(f"{word} {show_percent(after)}")
        elif before != after:
            words.append(f"{word} {before} -> {show_percent(after)}")
    if new or old.weight != to.weight:
        words.append(f"weight {to.weight}" if new else f"weight {old.weight} -> {to.weight}")
    return ", ".join(words)


def _why_here(old: int, to: int, *, new: bool) -> str:
    if new:
        return "while it is off nothing is promised yet"
    if to < old:
        return "what is given back comes before what is taken"
    return "after the others gave back" if to > old else "nothing is taken or given back"


@dataclass(frozen=True, slots=True, kw_only=True)
class Pause:
    """The rest of a change with a stop before it; `start` is what brings the partition back, where it is to run."""

    stop: Step
    between: tuple[Step, ...]
    start: Step | None


def pause_steps(rest: Sequence[Step], why: str, grace: int) -> Pause:
    """The remaining steps of a running partition, done while it is stopped, so that they claim nothing.

    Its guest may take `grace` milliseconds to shut down.
    """
    first = rest[0]
    address, held, last = first.address, first.claim_before, rest[-1].claim_after
    stop = Step(
        address=address,
        title=f"stop it, to make room ({_asked(grace)})",
        operation=StopPartition(partition=address.partition, grace_ms=grace, machine=address.machine),
        before={"exists": True, "running": True, "state": RunState.RUNNING.value},
        after={"exists": True, "running": False, "state": RunState.OFF.value},
        undo=Undo(
            level=UndoLevel.PARTIAL,
            operation=StartPartition(partition=address.partition, machine=address.machine),
            says=_STARTS_ANEW,
        ),
        disruption=Disruption.PARTITION_STOP,
        claim_before=held,
        claim_after=NO_CLAIM,
        comment=why,
        place=first.place,
    )
    kept = [step for step in rest if not isinstance(step.operation, StopPartition | StartPartition)]
    between = tuple(replace(step, claim_before=NO_CLAIM, claim_after=NO_CLAIM) for step in kept)
    if last == NO_CLAIM:
        return Pause(stop=stop, between=between, start=None)
    start = replace(
        stop,
        title="start it again",
        operation=StartPartition(partition=address.partition, machine=address.machine),
        before=stop.after,
        after=stop.before,
        undo=Undo(
            level=UndoLevel.FULL,
            operation=StopPartition(partition=address.partition, grace_ms=grace, machine=address.machine),
        ),
        disruption=Disruption.LIVE,
        claim_before=NO_CLAIM,
        claim_after=last,
        comment="it was stopped only to make room",
    )
    return Pause(stop=stop, between=between, start=start)
