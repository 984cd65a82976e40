"""A plan as a person reviews it: what changes, why, what it disturbs, and a last line that counts."""

from collections.abc import Iterator, Sequence
from typing import assert_never

from rarms_iac.model.changes import Adopt, Change, Create, Delete, Release, Update
from rarms_iac.model.diagnostics import Diagnostic, Place, Sources
from rarms_iac.model.operations import RemoveDisk
from rarms_iac.model.plan import HostPlan, Plan, Purpose, Step, UndoLevel
from rarms_iac.model.quantities import show_bytes, show_processors
from rarms_iac.model.system import Disruption
from rarms_iac.views.attributes import Attribute, attributes_of
from rarms_iac.views.diagnostics.layout import columns, visible, wrap
from rarms_iac.views.diagnostics.text import as_text, counted
from rarms_iac.views.placement import placement_says
from rarms_iac.views.threads import threads_lines
from rarms_iac.views.totals import totals_lines

WIDTH = 80
LEGEND = {"+": "create", "~": "change", "-/+": "replace", "-": "remove", ">": "adopt", "<": "release"}


def plan_text(plan: Plan, *, sources: Sources | None = None, steps: bool = False, width: int = WIDTH) -> str:
    """The whole plan as text without colour, ending with a line end.

    Args:
        plan: what is shown.
        sources: texts of the files that findings point into.
        steps: show the order of the steps, too.
        width: columns; only text is wrapped to it.
    """
    lines = [*_head(plan, width)]
    told = [part for part in plan.hosts if is_worth_showing(part)]
    for part in told:
        lines += ["", *_host(part, plan, width, steps=steps)]
    if told:
        lines += _as_wanted([part.host.name for part in plan.hosts if part not in told], width)
    if told and plan.placement is not None:
        lines += ["", *wrap(placement_says(plan.placement), min(width, WIDTH), "")]
    if plan.findings:
        lines += ["", *_findings(plan.findings, sources or {}, min(width, WIDTH))]
    if plan.accepted:
        lines += ["", f"{counted(len(plan.accepted), 'finding')} accepted by the policy."]
    return "\n".join([*lines, "", *wrap(summary(plan), width, "")]).lstrip("\n") + "\n"


def summary(plan: Plan) -> str:
    """The last line: how many of each, or that there is nothing to do."""
    held = sum(len(part.held_back) for part in plan.hosts)
    told = f"{held} held back." if held else ""
    if not any(part.changes or part.steps for part in plan.hosts):
        return f"No changes to make now; {told}" if held else _nothing(plan)
    counts = count(change for part in plan.hosts for change in part.changes)
    parts = [f"{counts['add']} to add", f"{counts['change']} to change", f"{counts['remove']} to remove"]
    parts += [f"{counts[name]} to {name}" for name in ("adopt", "release") if counts[name]]
    return f"Plan: {', '.join(parts)}.{' ' + told if told else ''}"


def count(changes: Iterator[Change]) -> dict[str, int]:
    """How many of each; one that is made again counts as removed and as added."""
    counts = dict.fromkeys(("add", "change", "remove", "adopt", "release"), 0)
    for change in changes:
        for name in _COUNTED[symbol(change)]:
            counts[name] += 1
    return counts


_COUNTED = {
    "+": ("add",),
    "~": ("change",),
    "-/+": ("add", "remove"),
    "-": ("remove",),
    ">": ("adopt",),
    "<": ("release",),
}


def symbol(change: Change) -> str:
    """What stands before a change: a key of `LEGEND`."""
    match change:
        case Create():
            return "+"
        case Update():
            return "-/+" if change.disruption is Disruption.REMOVAL else "~"
        case Delete():
            return "-"
        case Adopt():
            return ">"
        case Release():
            return "<"
        case _:
            assert_never(change)


def is_worth_showing(part: HostPlan) -> bool:
    """Whether a host has anything to be told but that all is as wanted."""
    return bool(part.changes or part.steps or part.held_back or part.unused)


def _nothing(plan: Plan) -> str:
    who = "The host is" if len(plan.hosts) == 1 else "The hosts are"
    match plan.purpose:
        case Purpose.APPLY:
            return f"No changes. {who} as the manifest wants {'it' if len(plan.hosts) == 1 else 'them'}."
        case Purpose.DESTROY:
            return (
                f"No changes. Nothing on {'the host' if len(plan.hosts) == 1 else 'the hosts'} is of this application."
            )
        case Purpose.IMPORT | Purpose.RELEASE:
            return "No changes."
        case _:
            assert_never(plan.purpose)


def _as_wanted(hosts: Sequence[str], width: int) -> Iterator[str]:
    if hosts:
        yield ""
        yield from wrap(f"No changes on {counted(len(hosts), 'more host')}: {', '.join(hosts)}.", width, "  ")


def _head(plan: Plan, width: int) -> Iterator[str]:
    if not any(is_worth_showing(part) for part in plan.hosts):
        return
    match plan.purpose:
        case Purpose.APPLY:
            what = "What the manifest asks for"
        case Purpose.DESTROY:
            what = "Removing what rarms made"
        case Purpose.IMPORT:
            what = "Taking over"
        case Purpose.RELEASE:
            what = "Letting go"
        case _:
            assert_never(plan.purpose)
    yield from wrap(f"{what}: {plan.application} (plan {plan.id}, from {visible(plan.manifest, keep='')})", width, "")
    used = {symbol(change) for part in plan.hosts for change in _all_changes(part)}
    if used:
        yield ""
        yield "  " + "   ".join(f"{sign} {says}" for sign, says in LEGEND.items() if sign in used)


def _all_changes(part: HostPlan) -> tuple[Change, ...]:
    return (*part.changes, *(held.change for held in part.held_back))


def _host(part: HostPlan, plan: Plan, width: int, *, steps: bool) -> Iterator[str]:
    facts = part.facts
    yield (
        f"Host {part.host.name} ({facts.provider.value}, {show_processors(facts.logical_processors)}, "
        f"{show_bytes(facts.memory)})"
    )
    new = _made_here(part)
    for change in part.changes:
        yield ""
        yield from _change(change, part, new, width)
    if part.unchanged:
        yield ""
        yield f"  {counted(part.unchanged, 'unchanged resource')} hidden."
    yield from _held_back(part, plan, width)
    yield from _unused(part, width)
    yield from _not_undone(part, width)
    yield from _disruption(part, width)
    if steps and part.steps:
        yield from _steps(part, width)
    yield from threads_lines(part, width)
    yield from totals_lines(part)


def _change(change: Change, part: HostPlan, new: frozenset[str], width: int) -> Iterator[str]:
    note = _note_on(change, part, new)
    head = f"  {symbol(change)} {change.address}" + (f", {note}" if note else "")
    place = _at(change.reason.place)
    yield from [head + place] if columns(head + place) <= width else [head, f"     {place}"]
    yield from wrap(change.reason.says, width, "      ")
    attributes = attributes_of(change, part.facts)
    if isinstance(change, Delete):
        attributes = tuple(attribute for attribute in attributes if attribute.name in _OF_THE_REMOVED)
    yield from _attributes(attributes, whole=isinstance(change, Create))


def _made_here(part: HostPlan) -> frozenset[str]:
    """The partitions that this plan makes."""
    made = (change.address for change in part.changes if isinstance(change, Create) and not change.address.task)
    return frozenset(address.partition for address in made if address.partition)


def _note_on(change: Change, part: HostPlan, new: frozenset[str]) -> str:
    """What the change disturbs here: the guest of a machine that is only being made starts with its task classes."""
    inside = change.address.partition if change.address.task else ""
    if any(isinstance(step.operation, RemoveDisk) and is_part_of(step, change) for step in part.steps):
        return "removed with a disk"
    return "" if inside in new else disturbs(change)


def is_part_of(step: Step, change: Change) -> bool:
    """Whether the step is about the same partition's machine or its disk."""
    return not change.address.task and step.address.partition == change.address.partition


_OF_THE_REMOVED = ("processors", "reserve", "memory")


def disturbs(change: Change) -> str:
    """What a change does to what runs, in words; nothing where it is live."""
    match change.disruption:
        case Disruption.LIVE:
            return ""
        case Disruption.PARTITION_STOP:
            return "when its partition starts again" if change.address.task else "stops the partition"
        case Disruption.HOST_RESTART:
            return "when the host starts again"
        case Disruption.REMOVAL:
            return "made again" if isinstance(change, Update) else "removed, its disks stay"
        case _:
            assert_never(change.disruption)


def _attributes(attributes: Sequence[Attribute], *, whole: bool) -> Iterator[str]:
    shown = [attribute for attribute in attributes if whole or attribute.differs]
    widest = max((columns(attribute.name) for attribute in shown), default=0)
    for one in shown:
        yield f"      {one.name}{' ' * (widest - columns(one.name))}  {_value(one)}{_note(one)}"
    hidden = len(attributes) - len(shown)
    if hidden:
        yield f"      ({counted(hidden, 'unchanged attribute')} hidden)"


def _value(attribute: Attribute) -> str:
    before, after = (None if text is None else visible(text, keep="") for text in (attribute.before, attribute.after))
    if before is None or after is None or before == after:
        return str(before if after is None else after)
    return f"{before} -> {after}"


def _note(attribute: Attribute) -> str:
    return f"  ({attribute.note})" if attribute.note else ""


def _at(place: Place | None) -> str:
    return "" if place is None else f"  ({visible(f'{place.file}:{place.line}', keep='')})"


def _held_back(part: HostPlan, plan: Plan, width: int) -> Iterator[str]:
    if not part.held_back:
        return
    yield ""
    yield f"  Held back, not in the plan (it may disturb at most: {plan.max_disruption.value}):"
    for held in part.held_back:
        yield f"  {symbol(held.change)} {held.change.address}" + _at(held.change.reason.place)
        yield from wrap(held.why, width, "      ")
        yield from _attributes(attributes_of(held.change, part.facts), whole=False)


def _unused(part: HostPlan, width: int) -> Iterator[str]:
    if part.unused:
        yield ""
        yield "  Unused: the manifest no longer wants them; they are stopped and stay."
        for name in part.unused:
            yield from wrap(
                f"partition/{name}: remove it with `rarms destroy --target partition/{name}`", width, "    "
            )


def _not_undone(part: HostPlan, width: int) -> Iterator[str]:
    lasting = [step for step in part.steps if step.undo.level is not UndoLevel.FULL]
    if lasting:
        yield ""
        yield "  What `rarms undo` cannot bring back:"
        for step in lasting:
            level = "partly" if step.undo.level is UndoLevel.PARTIAL else "not at all"
            yield from wrap(f"{step.address}, {step.title}: {level}; {step.undo.says}", width, "    ")


def _disruption(part: HostPlan, width: int) -> Iterator[str]:
    by_kind: dict[str, list[str]] = {}
    new = _made_here(part)
    for change in part.changes:
        note = _note_on(change, part, new)
        if note:
            by_kind.setdefault(note, []).append(str(change.address))
    if by_kind:
        yield ""
        yield "  Disturbs what runs:"
        for note, addresses in sorted(by_kind.items()):
            yield from wrap(f"{note}: {', '.join(addresses)}", width, "    ")


def _steps(part: HostPlan, width: int) -> Iterator[str]:
    yield ""
    yield "  Steps, in this order:"
    reasons = {change.address: change.reason.says for change in part.changes}
    digits = len(str(len(part.steps)))
    indent = " " * (digits + 4)
    for number, step in enumerate(part.steps, 1):
        head = wrap(f"{step.address}: {visible(step.title, keep='')}{_at(step.place)}", width, indent)
        yield f"  {number:>{digits}}. {next(head).lstrip()}"
        yield from head
        # The change's own reason stands above, beside the change.
        yield from wrap(step.comment.removeprefix(f"{reasons.get(step.address, '')}; "), width, indent)


def _findings(findings: Sequence[Diagnostic], sources: Sources, width: int) -> list[str]:
    return as_text(findings, sources, width=width).rstrip("\n").splitlines()
