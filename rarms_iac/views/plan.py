"""A plan as a person reviews it: a line a partition, what it disturbs and for how long, and a line that counts.

`plan_text` takes a Plan and returns a renderable.
"""

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import replace
from typing import TYPE_CHECKING, assert_never

from rarms_iac.applying.undo import is_removal
from rarms_iac.model.changes import Change, Create, Delete, Update
from rarms_iac.model.commands import prose
from rarms_iac.model.diagnostics import Place, Sources
from rarms_iac.model.host import Connect, LinuxHost, ProviderKind, Receiver, WinRmConnect
from rarms_iac.model.operations import RemoveDisk, RemovePartition, StartPartition, StopPartition
from rarms_iac.model.plan import HostPlan, Plan, Purpose, Step, UndoLevel, UnusedPartition
from rarms_iac.model.state import Mark, Partition, StoppedBy
from rarms_iac.model.totals import HostTotals
from rarms_iac.texts.messages import counted, in_a_row, natural_order
from rarms_iac.texts.plans import describe_placement
from rarms_iac.texts.quantities import show_bytes, show_duration, show_lp_percent, show_milliseconds, show_processors
from rarms_iac.views.changes import (
    SYMBOLS,
    AttributeText,
    attributes_of,
    describe_counts,
    describe_disruption,
    members_of,
    tasks_of_created,
)
from rarms_iac.views.console import BAD, CHANGED, DIM, GOOD, NOTE, STRONG, paragraph, stack, styled, visible
from rarms_iac.views.findings_text import findings_text
from rarms_iac.views.status import describe_totals
from rarms_iac.views.table import Column, Table

if TYPE_CHECKING:
    from rich.console import RenderableType
    from rich.text import Text

STYLES = {"+": GOOD, "~": CHANGED, "-/+": BAD, "-": BAD, ">": NOTE, "<": NOTE}
TITLES = {
    Purpose.APPLY: "apply",
    Purpose.DESTROY: "remove all that rarms created",
    Purpose.IMPORT: "import",
    Purpose.RELEASE: "release",
    Purpose.STOP: "stop partitions",
    Purpose.START: "start partitions",
}


def plan_text(plan: Plan, *, sources: Sources | None = None, verbose: bool = False) -> "RenderableType":
    """Show the plan, a line a partition.

    Args:
        sources: texts of the files that findings point into.
        verbose: show every attribute, reason and manifest line, the thread priorities and the order of the steps, too.
    """
    changed = [
        part for part in plan.hosts if part.changes or part.steps or part.held_back or part.unused or part.stopped
    ]
    parts: list[RenderableType] = []
    if changed:
        parts.append(paragraph(plan_title(plan)))
        for part in changed:
            parts += _planned_host(part, verbose=verbose)
        quiet = [part.host.name for part in plan.hosts if part not in changed]
        if quiet:
            parts.append(paragraph(f"No changes on {counted(len(quiet), 'more host')}: {', '.join(quiet)}."))
        if verbose and plan.placement is not None:
            parts.append(paragraph(describe_placement(plan.placement)))
        parts.append("")
    return stack(
        *parts, *_findings(plan, sources or {}, verbose=verbose), paragraph(styled((plan_summary(plan), STRONG)))
    )


def plan_title(plan: Plan) -> str:
    """Write as `Plan e1b8e52e55c8 to apply: delivery-robot on robot-3, from rarms.yaml with laptop.yaml`."""
    manifest = visible(" with ".join([plan.manifest, *plan.overlays]), keep="")
    robot = f" on {plan.robot}" if plan.robot else ""
    provisional = ", provisional" if plan.provisional else ""
    return f"Plan {plan.id} to {TITLES[plan.purpose]}: {plan.application}{robot}, from {manifest}{provisional}"


def _findings(plan: Plan, sources: Sources, *, verbose: bool) -> "Iterator[RenderableType]":
    if plan.findings:
        yield findings_text(plan.findings, sources, brief=not verbose)
        yield ""
    if plan.accepted:
        yield f"{counted(len(plan.accepted), 'finding')} accepted by the policy."
        yield ""


def plan_summary(plan: Plan) -> str:
    """Return the last line: how many of each, or that there is nothing to do."""
    number = sum(len(part.held_back) for part in plan.hosts)
    held = f"{number} held back." if number else ""
    if not any(part.changes or part.steps for part in plan.hosts):
        return f"No changes to make now; {held}" if held else _nothing(plan)
    return f"{_counts(plan)}{' ' + held if held else ''}"


def _counts(plan: Plan) -> str:
    return f"Plan: {describe_counts(plan.hosts, done=False)}."


def _nothing(plan: Plan) -> str:
    hosts, are = ("host", "is") if len(plan.hosts) == 1 else ("hosts", "are")
    match plan.purpose:
        case Purpose.APPLY:
            return f"No changes. The {hosts} {are} as in the manifest."
        case Purpose.DESTROY:
            return f"No changes. No resource of this application exists on the {hosts}."
        case Purpose.STOP:
            return "No changes. None of these partitions should be running."
        case Purpose.START:
            return "No changes. None of these partitions was stopped by rarms."
        case Purpose.IMPORT | Purpose.RELEASE:
            return "No changes."
        case _:
            assert_never(plan.purpose)


def _planned_host(part: HostPlan, *, verbose: bool) -> "Iterator[RenderableType]":
    yield from _changed_host(part, verbose=verbose)
    yield from _stated(part, verbose=verbose)
    yield from _not_undone(part)
    if verbose:
        yield from (paragraph(visible(text, keep=""), indent=2) for text in _whereabouts(part))
        yield from _details(part)
        yield from _steps(part)


def _afterwards(totals: HostTotals) -> Iterator[str]:
    """Yield a line for the processors and one for the memory of a host after the plan, and one for what is off."""
    promised = totals.promised
    yield f"Afterwards: {describe_totals(totals)}."
    yield f"Memory: {_describe_memory(totals)}."
    if promised.idle_percent or promised.idle_memory:
        idle = f"{show_processors(promised.idle_lp)} and {show_bytes(promised.idle_memory)}"
        yield f"Of these, {idle} are reserved for partitions that are off."


def _describe_memory(totals: HostTotals) -> str:
    """Write as `1 GiB of 4 GiB reserved, 1 GiB kept for the host, 2 GiB free`."""
    others, kept = totals.promised.others_memory, totals.kept_memory
    parts = [f"{show_bytes(totals.promised.memory)} of {show_bytes(totals.memory)} reserved"]
    parts += [f"{show_bytes(others)} by unmanaged partitions"] if others else []
    parts += [f"{show_bytes(kept)} kept for the host"] if kept else []
    return ", ".join([*parts, f"{show_bytes(totals.free_memory)} free"])


def _receiver(connect: Connect | WinRmConnect) -> str | None:
    """Return the receiver of scripts there, where it is not sent with them."""
    return None if connect.receiver is Receiver.SENT else connect.receiver.value


def _whereabouts(part: HostPlan) -> Iterator[str]:
    """Describe the host and connection that `rarms apply` uses."""
    connect, settings = part.host.connect, part.host.settings
    match connect:
        case Connect():
            options = {
                "port": connect.port,
                "key": connect.key,
                "jump": connect.jump,
                "control path": connect.control_path,
                "receiver": _receiver(connect),
            }
            yield f"Connection: ssh {connect.ssh}, shell {connect.shell}{_options(options)}."
        case WinRmConnect(password=password):
            name = None if password is None else password.name
            account = {
                "port": connect.port,
                "user": connect.user,
                "password from": name,
                "receiver": _receiver(connect),
            }
            yield f"Connection: WinRM {connect.winrm}, shell {connect.shell}{_options(account)}."
        case None:
            pass
        case _:
            assert_never(connect)
    if isinstance(settings, LinuxHost):
        yield f"Control groups: {settings.slice} (version: {settings.control_groups})."
    if part.state_path:
        yield f"State file: {part.state_path}, relative to the manifest."


def _options(given: Mapping[str, str | int | None]) -> str:
    return "".join(f", {name} {value}" for name, value in given.items() if value is not None)


def _changed_host(part: HostPlan, *, verbose: bool) -> "Iterator[RenderableType]":
    facts, promised = part.facts, int(part.host.memory)
    memory = show_bytes(facts.memory, promised)
    if promised < facts.memory:  # the manifest promises no more, and what is free is counted from it
        memory = f"{show_bytes(promised, facts.memory)} of its {memory}"
    yield ""
    head = f"Host {part.host.name} ({facts.provider.value}, {show_processors(facts.logical_processors)}, "
    yield styled((f"{head}{memory})", STRONG))
    if verbose:
        for change in part.changes:
            yield from _full_change(change, part)
        yield replace(plan_table(part), rows=())
    else:
        yield plan_table(part)


def _stated(part: HostPlan, *, verbose: bool) -> "Iterator[RenderableType]":
    """Yield the resources that are not changed, with the reason."""
    if verbose and part.unchanged:
        yield paragraph(f"{counted(part.unchanged, 'unchanged resource')} hidden.", indent=2)
    if verbose:
        for held in part.held_back:
            yield from _full_change(held.change, part, f"held back: {held.why}")
    for unused in part.unused:
        name, holds = unused.name, describe_held(unused)
        yield paragraph(
            prose(
                f"partition/{name} is no longer in the manifest and is stopped{holds}. Remove it with ",
                part.commands[name],
                ".",
            ),
            indent=2,
        )
    for name in part.stopped:
        yield paragraph(
            prose(f"partition/{name} stays stopped, as requested. ", part.commands[name], " starts it."),
            indent=2,
        )


def _details(part: HostPlan) -> "Iterator[RenderableType]":
    for name, mechanism in (part.mechanisms or {}).items():
        yield paragraph(f"partition/{name} is {mechanism}.", indent=2)
    yield from _threads(part)


CHANGES = (
    Column("change", wraps=True),
    Column("reservation", right=True, wraps=True),
    Column("memory", right=True, wraps=True),
    Column("remark", wraps=True),
)
ATTRIBUTES = (Column("attribute"), Column("value", wraps=True), Column("note", wraps=True))
THREADS = (
    Column("where"),
    Column("priority", right=True),
    Column("task class"),
    Column("category"),
    Column("components", wraps=True),
)


def plan_table(part: HostPlan) -> Table:
    """Return a row a change of a host: partitions by name, then the rest in the plan's order, then what is held back.

    Its last lines sum up what the host has reserved after the plan.

    A task class that is added with its partition is a remark of that one.
    """
    classes = tasks_of_created(part.changes)
    changes = [
        change for change in part.changes if change.address.task not in classes.get(change.address.partition, ())
    ]
    changes.sort(key=lambda change: (bool(change.address.task), natural_order(change.address.partition)))
    rows = [_row(change, part, classes) for change in changes]
    rows += [_row(held.change, part, {}, f"held back: {held.why}") for held in part.held_back]
    totals = () if part.host_totals is None else tuple(_afterwards(part.host_totals))
    return Table(CHANGES, rows, totals=totals, indent=2)


def describe_held(unused: UnusedPartition) -> str:
    """Say what an unused partition still holds, after a comma; empty: nothing."""
    held = [counted(len(unused.disks), "disk") + f" ({', '.join(unused.disks)})"] if unused.disks else []
    held += [f"{show_bytes(unused.memory_on_disk)} on the host's disk to save it"] if unused.memory_on_disk else []
    return f", and still uses {in_a_row(held)}" if held else ""


def _row(
    change: Change, part: HostPlan, classes: Mapping[str, Sequence[str]], held: str = ""
) -> "tuple[Text | str, ...]":
    """Write as `+ hmi [hmi, historian]`, `1.16 LP`, `1 GiB`, `limit 1.5 LP, task Localization`."""
    shown = {attribute.name: attribute for attribute in attributes_of(change, part.facts)}
    reserve, memory = ("" if name not in shown else _value(shown[name]) for name in ("reserve", "memory"))
    remarks = [
        f"{name} {_value(attribute)}"
        for name, attribute in shown.items()
        if attribute.differs and name not in {"reserve", "memory"} and not isinstance(change, Create | Delete)
    ]
    if isinstance(change, Create):
        limit = shown.get("limit")
        remarks += [f"limit {limit.after}"] if limit is not None and limit.after != "none" else []
        if part.facts.provider is ProviderKind.HYPERV and "weight" in shown:
            remarks.append(f"weight {shown['weight'].after}")
        tasks = ", ".join(classes.get(change.address.partition, ()))
        remarks += [f"task {tasks}"] if tasks else []
    remarks += [_start_of(change, part)] if not held else []
    remark = "; ".join(filter(None, [", ".join(filter(None, remarks)), disruption_of(change, part), held]))
    return _name(change, part), reserve, memory, remark


def _start_of(change: Change, part: HostPlan) -> str:
    """Write what a partition reserves while it starts: `starts with 1 LP for 30 s`; empty: no more than later."""
    for step in part.steps:
        if step.address == change.address and step.wait_ms:
            reserved = show_lp_percent(step.claim_before.percent)
            return f"starts with {reserved} for {show_duration(step.wait_ms)}"
    return ""


def _name(change: Change, part: HostPlan) -> "Text":
    sign, address = SYMBOLS[change.action], change.address.in_short
    members = "" if change.address.task else members_of(change.address.partition, part.components)
    return styled((sign, STYLES[sign]), " ", (address, STRONG), members)


def disruption_of(change: Change, part: HostPlan) -> str:
    """Return the disruption of the change on this host, and its duration."""
    if change.address.task:
        created = any(
            isinstance(other, Create) and other.address.partition == change.address.partition and not other.address.task
            for other in part.changes
        )
        # the guest of a machine that is only being made starts with its task classes
        return "" if created and change.address.partition else describe_disruption(change)
    steps = [step for step in part.steps if is_part_of(step, change)]
    operations = [step.operation for step in steps]
    note = describe_disruption(change)
    if any(isinstance(operation, RemoveDisk) for operation in operations):
        note = "removed with a disk"
    elif any(isinstance(step.operation, RemovePartition) and step.before.get("disks") for step in steps):
        note = f"{note}, disks stay"
    stop = next((operation for operation in operations if isinstance(operation, StopPartition)), None)
    if stop is None:
        return note or _left_stopped(change)
    is_linux = part.facts.provider is ProviderKind.LINUX
    at_once = "its processes are killed" if is_linux else "turned off without a shutdown"
    to_end = "to end its processes" if is_linux else "to shut down"
    grace = f"{show_milliseconds(stop.grace_ms)} {to_end}" if stop.grace_ms else ""
    if not isinstance(change, Update):
        return f"{note}; {f'up to {grace}' if grace else at_once}"
    starts = any(isinstance(operation, StartPartition) for operation in operations)
    duration = f"{'stopped for ' if starts else ''}up to {grace}" if grace else at_once
    made_again = "made again; " if change.action == "replace" else ""
    return f"{made_again}{duration}{', then for its start' if starts else ''}"


def _left_stopped(change: Change) -> str:
    """Return the reason for the start of a partition that was not named."""
    match change:
        case Update(before=Partition(mark=Mark(stopped_by=StoppedBy.MEASUREMENT))):
            return "stopped by a measurement and not started again"
        case _:
            return ""


def is_part_of(step: Step, change: Change) -> bool:
    """Return whether the step's address is in this change's partition; never for a task class's change."""
    return not change.address.task and step.address.partition == change.address.partition


def _full_change(change: Change, part: HostPlan, held: str = "") -> "Iterator[RenderableType]":
    note = "; ".join(filter(None, [disruption_of(change, part), held]))
    yield paragraph(
        styled(_name(change, part), f", {note}" if note else "", _at(change.reason.place)), indent=2, more=4
    )
    if change.reason.message:
        yield paragraph(change.reason.message, indent=6)
    rows = [_attribute(attribute) for attribute in attributes_of(change, part.facts)]
    yield Table(ATTRIBUTES, rows, header=False, indent=6)


def _attribute(attribute: AttributeText) -> "tuple[Text | str, ...]":
    note = f"forces {attribute.forces}" if attribute.forces else attribute.note
    return attribute.name, _value(attribute), styled((f"({note})" if note else "", BAD if attribute.forces else DIM))


def _value(attribute: AttributeText) -> str:
    before, after = attribute.before, attribute.after
    if before is None or after is None or before == after:
        return str(before if after is None else after)
    return f"{before} -> {after}"


def _at(place: Place | None) -> str:
    return "" if place is None else f"  ({visible(f'{place.file}:{place.line}', keep='')})"


def _not_undone(part: HostPlan) -> "Iterator[RenderableType]":
    removed = {step.address.partition for step in part.steps if is_removal(step)}
    lasting = [
        step
        for step in part.steps
        if step.undo.level is UndoLevel.NONE
        or (step.undo.level is UndoLevel.PARTIAL and step.address.partition not in removed)
    ]
    for step in sorted(lasting, key=lambda step: natural_order(str(step.address))):
        level = "can be undone only in part" if step.undo.level is UndoLevel.PARTIAL else "cannot be undone"
        yield paragraph(f"{step.address}, {step.title}: {level}; {step.undo.message}", indent=2, more=2)


def _threads(part: HostPlan) -> "Iterator[RenderableType]":
    """Yield the priorities of task classes' threads, where the plan or a guest's script changes task classes."""
    changes = any(change.address.task for change in part.changes) or any(".guest." in name for name in part.scripts)
    if not changes or not part.threads:
        return
    yield "  Thread priorities, after its Windows has restarted:"
    rows = [
        (
            f"partition/{thread.inside}" if thread.inside else "the host itself",
            str(thread.thread_priority),
            thread.task,
            thread.category,
            ", ".join(thread.components),
        )
        for thread in part.threads
    ]
    yield Table(THREADS, rows, indent=4)


def _steps(part: HostPlan) -> "Iterator[RenderableType]":
    if part.steps:
        yield "  Steps, in this order:"
    for number, step in enumerate(part.steps, 1):
        start = f"  {number:>{len(str(len(part.steps)))}}. "
        yield paragraph(f"{step.address}: {visible(step.title, keep='')}{_at(step.place)}", start=start)
        yield paragraph(step.comment, indent=len(start))
