"""Changes in words: their symbols and counts, what each does to each attribute, and `rarms drift`, which lists them."""

from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, assert_never

from rarms_iac.app.drift import ComparedHost, DriftReport
from rarms_iac.diff.drift import DriftKind, ResourceDrift
from rarms_iac.model.changes import Adopt, Change, Create, Delete, Forced, Release, Resource, Update, count
from rarms_iac.model.commands import APPLY, PLAN, prose
from rarms_iac.model.diagnostics import Diagnostic
from rarms_iac.model.facets import LABELS, NO_LIMIT, settings_of
from rarms_iac.model.plan import HostPlan
from rarms_iac.model.quantities import guaranteed
from rarms_iac.model.state import HostFacts, Partition, PartitionSettings, Responsiveness, TaskClass
from rarms_iac.model.system import Disruption
from rarms_iac.texts.messages import counted, in_a_row, natural_order
from rarms_iac.texts.plans import setting_text
from rarms_iac.texts.quantities import share_of_host, share_of_processors, show_processors
from rarms_iac.views.console import STRONG, paragraph, stack, styled
from rarms_iac.views.table import Column, Row, Table

if TYPE_CHECKING:
    from rich.console import RenderableType


SYMBOLS = {"create": "+", "update": "~", "replace": "-/+", "delete": "-", "adopt": ">", "release": "<"}
"""What stands before a change, by its action."""


def describe_disruption(change: Change) -> str:
    """Return the disruption of a change in words; nothing where it is live."""
    match change.disruption:
        case Disruption.LIVE:
            return ""
        case Disruption.PARTITION_STOP:
            return "when its partition starts again" if change.address.task else "stops the partition"
        case Disruption.HOST_RESTART:
            return "when the host starts again"
        case Disruption.REMOVAL:
            return "made again" if isinstance(change, Update) else "removed"
        case _:
            assert_never(change.disruption)


def tasks_of_created(changes: Sequence[Change]) -> dict[str, list[str]]:
    """Return the task classes that are added with their partition, by its name: they stand in its line."""
    created = {change.address.partition for change in changes if isinstance(change, Create) and not change.address.task}
    tasks: dict[str, list[str]] = {}
    for change in changes:
        if isinstance(change, Create) and change.address.is_in_guest and change.address.partition in created:
            tasks.setdefault(change.address.partition, []).append(change.address.task)
    return tasks


COUNTED = {"add": "added", "change": "changed", "remove": "removed", "adopt": "adopted", "release": "released"}
"""What a plan counts, and how it is said when it is done."""


def describe_counts(hosts: Iterable[HostPlan], *, done: bool) -> str:
    """Write as `6 to add (2 task classes with their partitions), 0 to change`, or `6 added ...` when done."""
    changes = [part.changes for part in hosts]
    counts = count(change for own in changes for change in own)
    words = {
        name: f"{counts[name]} {past if done else 'to ' + name}"
        for name, past in COUNTED.items()
        if counts[name] or name not in {"adopt", "release"}
    }
    if tasks := sum(len(names) for own in changes for names in tasks_of_created(own).values()):
        kind, owner = ("task class", "its partition") if tasks == 1 else ("task classes", "their partitions")
        words["add"] += f" ({tasks} {kind} with {owner})"
    return ", ".join(words.values())


def members_of(partition: str, components: Mapping[str, Sequence[str]]) -> str:
    """List a partition's members as ` [hmi, historian]`, if its name does not say them."""
    members = tuple(components.get(partition, ()))
    return f" [{', '.join(members)}]" if members and members != (partition,) else ""


@dataclass(frozen=True, slots=True, kw_only=True)
class AttributeText:
    """One attribute of a change in words; `before` and `after` are None where the resource is not there."""

    name: str
    before: str | None
    after: str | None
    note: str = ""  # what it amounts to
    forces: Forced = ""

    @property
    def differs(self) -> bool:
        """Whether the change touches it."""
        return self.before != self.after


def attributes_of(change: Change, facts: HostFacts) -> tuple[AttributeText, ...]:
    """Return all attributes of the change's resource, including unchanged ones."""
    match change:
        case Create(after=after):
            return _pairs({}, _values(after, facts))
        case Delete(before=before):
            return _pairs(_values(before, facts), {})
        case Update(before=before, after=after):
            forced = {touched.name.replace("_", " "): touched.forces for touched in change.attributes}
            pairs = _pairs(_values(before, facts), _values(after, facts))
            return tuple(replace(pair, forces=forced.get(pair.name, "")) for pair in pairs)
        case Adopt() | Release():
            return (_mark_of(change),)
        case _:
            assert_never(change)


def _mark_of(change: Adopt | Release) -> AttributeText:
    def shown(partition: Partition) -> str:
        return f"{partition.mark.application}/{partition.mark.name}" if partition.mark else "none"

    return AttributeText(name="mark", before=shown(change.before), after=shown(change.after))


_AttributeTexts = Mapping[str, tuple[str, str]]
"""By the attribute's name: its value and a note on it."""


def _values(resource: Resource, facts: HostFacts) -> _AttributeTexts:
    match resource:
        case Partition(settings=settings):
            return _settings(settings, facts)
        case TaskClass(values=values) | Responsiveness(values=values):
            return {name: (f"{value.data} ({value.kind.value})", "") for name, value in sorted(values.items())}
        case _:
            assert_never(resource)


def _settings(settings: PartitionSettings, facts: HostFacts) -> _AttributeTexts:
    return {
        LABELS[field]: (text, _note(field, settings, facts))
        for field in settings_of(settings.generation)
        if (text := setting_text(field, settings))  # empty: not known
    }


def _note(field: str, settings: PartitionSettings, facts: HostFacts) -> str:
    """Return the shares of the partition's processors and of the host that a reserve or limit is."""
    if field == "quota_period_us":
        return "the period of the limit"
    if field == "threads":
        return "their priority, of SCHED_FIFO"
    if field == "reserve" or (field == "limit" and settings.limit < NO_LIMIT):
        percent = getattr(settings, field)
        amount = guaranteed(percent, settings.processors)
        own = share_of_processors(percent, settings.processors)
        return f"{own}, {share_of_host(amount, facts.logical_processors, facts.name)}"
    return ""


def _pairs(before: _AttributeTexts, after: _AttributeTexts) -> tuple[AttributeText, ...]:
    return tuple(
        AttributeText(
            name=name,
            before=before[name][0] if name in before else None,
            after=after[name][0] if name in after else None,
            note=after[name][1] if name in after else "",
        )
        for name in dict.fromkeys([*before, *after])
    )


TITLES = {
    DriftKind.HOST_CHANGED: "changed on the host",
    DriftKind.NOT_APPLIED: "not applied yet",
    DriftKind.BOTH: "changed on the host, and not applied yet",
    DriftKind.MISSING: "not there",
    DriftKind.UNMANAGED: "not managed by rarms",
    DriftKind.REMOVED: "removed from the host",
    DriftKind.UNUSED: "unused",
}


def drift_text(report: DriftReport) -> "RenderableType":
    """Show of each difference what is there, and what the manifest wants."""
    parts = [part for host in report.hosts if host.drifted for part in _drifted_host(host)]
    problems = report.problems
    if report.unfinished:
        names = ", ".join(sorted(report.unfinished, key=natural_order))
        parts.append(paragraph(prose(f"A run is unfinished on {names}: ", APPLY, " finishes it.")))
    if problems:
        reasons = name_findings(problems)
        parts.append(paragraph(prose(f"The manifest was not compared: {reasons}. ", PLAN, " shows the causes.")))
    ending = [paragraph(styled((_summary(report), STRONG)))]
    if not report.unfinished and not problems and PLAN in report.commands:
        ending.append(paragraph(prose("Next: ", PLAN, " shows the changes that are not applied.")))
    return stack(*parts, *ending)


def name_findings(findings: Sequence[Diagnostic]) -> str:
    """List codes as `RARMS014 (reservations exceed the platform)`, each once."""
    return ", ".join(dict.fromkeys(f"{finding.code} ({finding.summary})" for finding in findings))


DRIFTED = (
    Column("resource", wraps=True),
    Column("state", wraps=True),
    Column("setting", wraps=True),
    Column("on the host", right=True),
    Column("wanted", right=True),
)


def _drifted_host(host: ComparedHost) -> "Iterator[RenderableType]":
    yield styled((f"Host {host.name} ({show_processors(host.host_lp)})", STRONG))
    ordered = sorted(host.drifted, key=lambda each: natural_order(str(each.address)))
    yield Table(DRIFTED, [row for drifted in ordered for row in _drift_rows(drifted, host.seen.facts)], indent=2)
    yield ""


def _drift_rows(drifted: ResourceDrift, facts: HostFacts) -> "Iterator[Row]":
    """Yield a row for each setting that differs; of a resource that is missing, for its reserve alone."""
    address = drifted.address
    name = address.in_short + members_of(address.partition, {address.partition: drifted.components})
    attributes = () if drifted.change is None else attributes_of(drifted.change, facts)
    differing = [
        (attribute.name, attribute.before or "", attribute.after)
        for attribute in attributes
        if attribute.differs and attribute.after and (attribute.before or attribute.name == "reserve")
    ]
    is_compared = any(before for _, before, _ in differing)
    first, *others = differing or [("", "", "")]
    yield (name, TITLES[drifted.drift] if is_compared else drifted.message, *first)
    yield from (("", "", *other) for other in others)


def _summary(report: DriftReport) -> str:
    changed = sum(host.host_changed for host in report.hosts)
    waiting = sum(host.not_applied for host in report.hosts)
    unused = sum(host.unused for host in report.hosts)
    if not changed and not waiting:
        extra = f" {counted(unused, 'partition')} unused." if unused else ""
        if not any(host.is_written for host in report.hosts):
            hosts = in_a_row([host.name for host in report.hosts])
            return f"No drift. No resource of {report.application} exists on {hosts}."
        wanted = "" if report.problems else ", and match the manifest"
        return f"No drift. The partitions of rarms are unchanged{wanted}.{extra}"
    return f"Drift: {changed} changed on the host, {waiting} not applied yet."
