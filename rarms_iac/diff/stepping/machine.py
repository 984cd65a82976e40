"""One machine on its way through its steps, and the single calls that take it there."""

from dataclasses import dataclass, replace
from fractions import Fraction
from math import ceil

from rarms_iac.diff.claims import claim_of
from rarms_iac.diff.readings import partition_readings
from rarms_iac.model.changes import Address, Reason
from rarms_iac.model.operations import (
    EraseMark,
    Operation,
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
from rarms_iac.model.state import Checkpoints, Facet, Mark, Partition, PartitionSettings, RunState
from rarms_iac.model.system import GRACE, Disruption

STARTS_ANEW = "it starts anew: what its programs had in memory is lost"
_NOT_PAUSED_AGAIN = Undo(level=UndoLevel.NONE, operation=None, says="it was paused: it is not so again")
WITH_ITS_MACHINE = Undo(level=UndoLevel.FULL, operation=None, says="it goes with the machine, which is removed")


@dataclass(slots=True)
class Machine:
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
        """The step from what is there now to `after`, read by `names`; `lost` is what its undo cannot bring back."""
        before, self.now = self.now, after
        level = UndoLevel.PARTIAL if lost else UndoLevel.FULL
        return Step(
            address=self.address,
            title=title,
            operation=operation,
            before=some_readings(before, () if self.new else names),
            after=some_readings(after, names),
            undo=WITH_ITS_MACHINE if self.new else Undo(level=level, operation=back, says=lost),
            disruption=disruption,
            claim_before=claim_of(before),
            claim_after=claim_of(after),
            comment=f"{self.reason.says}; {why}" if self.reason.says else why,
            place=self.reason.place,
        )


def some_readings(partition: Partition, names: tuple[str, ...]) -> Readings:
    """Of all that can be read of it these names, and that it exists."""
    everything = partition_readings(partition)
    return {name: everything[name] for name in ("exists", *names)}


def mark_step(machine: Machine, new: Mark, old: Mark | None, why: str) -> Step:
    """Write the mark; its undo writes the old one, or erases it where there was none."""
    at = machine.address
    marked = replace(machine.now, mark=replace(new, machine=machine.now.id[:8]))

    def write(mark: Mark) -> WriteMark:
        return WriteMark(
            partition=at.partition, application=mark.application, name=mark.name, set=mark.set, machine=at.machine
        )

    back = write(old) if old else EraseMark(partition=at.partition, machine=at.machine)
    title = f"mark it as {new.application}/{new.name}, set {new.set}"
    return machine.step(write(new), back, marked, ("mark", "set"), title, why)


def facet_step(machine: Machine, facet: Facet, old: PartitionSettings, new: PartitionSettings) -> Step:
    """One call that gives the machine all that `new` says of this facet; its undo gives it what `old` says."""
    match facet:
        case Facet.PROCESSORS:
            return _set_processors(machine, old, new)
        case Facet.CPU:
            return _set_cpu(machine, old, new)
        case Facet.MEMORY:
            return _set_memory(machine, old, new)
        case Facet.ACTIONS:
            return _set_actions(machine, old, new)
        case Facet.NAME | Facet.GENERATION:
            raise AssertionError("names and generations have steps of their own")


def _set_processors(machine: Machine, old: PartitionSettings, new: PartitionSettings) -> Step:
    at, settings = machine.address, machine.now.settings
    return machine.step(
        SetProcessors(partition=at.partition, processors=new.processors, machine=at.machine),
        SetProcessors(partition=at.partition, processors=old.processors, machine=at.machine),
        replace(machine.now, settings=replace(settings, processors=new.processors)),
        ("processors", "state"),
        _title("processors", old.processors, new.processors, new=machine.new),
        "only while it is off",
    )


def _set_cpu(machine: Machine, old: PartitionSettings, new: PartitionSettings) -> Step:
    settings = replace(machine.now.settings, reserve=new.reserve, limit=new.limit, weight=new.weight)
    return machine.step(
        _cpu(machine.address, new),
        _cpu(machine.address, old),
        replace(machine.now, settings=settings),
        ("reserve", "limit", "weight"),
        _cpu_title(old, new, new=machine.new),
        _why_here(old.reserve, new.reserve, new=machine.new),
    )


def _set_memory(machine: Machine, old: PartitionSettings, new: PartitionSettings) -> Step:
    settings = replace(machine.now.settings, memory=new.memory, dynamic_memory=new.dynamic_memory)
    static = "" if old.dynamic_memory == new.dynamic_memory else ", static"
    return machine.step(
        _memory(machine.address, new),
        _memory(machine.address, old),
        replace(machine.now, settings=settings),
        ("memory", "dynamic_memory", *(("state",) if machine.now.state is RunState.OFF else ())),
        _title("memory", show_bytes(old.memory), show_bytes(new.memory), new=machine.new) + static,
        _why_here(old.memory, new.memory, new=machine.new),
    )


def _set_actions(machine: Machine, old: PartitionSettings, new: PartitionSettings) -> Step:
    settings = replace(
        machine.now.settings,
        start_action=new.start_action,
        stop_action=new.stop_action,
        checkpoints=new.checkpoints,
    )
    return machine.step(
        _actions(machine.address, new),
        _actions(machine.address, old),
        replace(machine.now, settings=settings),
        ("start_action", "stop_action", "checkpoints"),
        _with_its_host(new),
        "what its host does with it",
    )


def _with_its_host(to: PartitionSettings) -> str:
    start, stop = to.start_action.value.replace("_", " "), to.stop_action.value.replace("_", " ")
    kept = "no" if to.checkpoints is Checkpoints.DISABLED else to.checkpoints.value.replace("_", " ")
    return f"when the host starts: {start}, when it stops: {stop}; {kept} checkpoints"


def _cpu(at: Address, to: PartitionSettings) -> SetCpu:
    return SetCpu(partition=at.partition, reserve=to.reserve, limit=to.limit, weight=to.weight, machine=at.machine)


def _memory(at: Address, to: PartitionSettings) -> SetMemory:
    return SetMemory(partition=at.partition, memory=to.memory, dynamic=to.dynamic_memory, machine=at.machine)


def _actions(at: Address, to: PartitionSettings) -> SetActions:
    return SetActions(
        partition=at.partition,
        start=to.start_action,
        stop=to.stop_action,
        checkpoints=to.checkpoints,
        machine=at.machine,
    )


def rename_step(machine: Machine, old: str, new: str) -> Step:
    """Give the machine the name that people see."""
    at = machine.address
    return machine.step(
        RenamePartition(partition=at.partition, name=new, machine=at.machine),
        RenamePartition(partition=at.partition, name=old, machine=at.machine),
        replace(machine.now, settings=replace(machine.now.settings, name=new)),
        ("name",),
        f"name {old} -> {new}",
        "its settings stay",
    )


def stop_step(machine: Machine, why: str) -> Step:
    """Read as running: a machine that was saved or paused since the plan is none that was stopped."""
    at, was_running = machine.address, machine.now.settings.running
    stop = machine.step(
        StopPartition(partition=at.partition, grace_ms=machine.grace_ms, machine=at.machine),
        StartPartition(partition=at.partition, machine=at.machine),
        replace(machine.now, settings=replace(machine.now.settings, running=False), state=RunState.OFF),
        ("running", "state"),
        f"stop it ({asked(machine.grace_ms)})" if was_running else "turn it off",
        why,
        disruption=Disruption.PARTITION_STOP,
        lost=STARTS_ANEW,
    )
    return stop if was_running else replace(stop, undo=_NOT_PAUSED_AGAIN)


def asked(grace: int) -> str:
    """How a guest is stopped that has `grace` milliseconds to shut down, in words."""
    return f"asked; after {plain(Fraction(grace, 1000))} s turned off" if grace else "turned off, not asked"


def start_step(machine: Machine) -> Step:
    """Start it, the last of its steps."""
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
