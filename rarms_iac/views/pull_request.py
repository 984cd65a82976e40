"""A plan as the comment of a pull request: risk first, then before and after, then what changed in logs and scripts.

Everything in it may come from a stranger's manifest: each piece of text is escaped for Markdown and HTML. A comment
holds 65,536 characters; each part has its share of that, and says what it leaves out.
"""

from collections.abc import Callable, Iterator, Sequence
from dataclasses import replace
from typing import TYPE_CHECKING

from rarms_iac.app.manifests import Manifest
from rarms_iac.app.pull_request import AptHeadroom, PlanReview
from rarms_iac.app.use_case_errors import UseCaseError
from rarms_iac.model.changes import Change, Create, Delete, Update
from rarms_iac.model.diagnostics import Diagnostic, Places, Severity
from rarms_iac.model.host import ProviderKind
from rarms_iac.model.indexes import index_named, show_threshold, show_value
from rarms_iac.model.operations import RemoveDisk, StartPartition, StopPartition
from rarms_iac.model.plan import HostPlan, Plan, UndoLevel
from rarms_iac.model.quantities import guaranteed, share_of_host, show_milliseconds, show_processors, write_bytes
from rarms_iac.model.state import Partition, PartitionSettings
from rarms_iac.model.system import Disruption
from rarms_iac.model.wording import counted, in_a_row
from rarms_iac.views.changes import SYMBOLS, attributes_of, describe_disruption
from rarms_iac.views.console import UNLIMITED, render
from rarms_iac.views.finding_forms import OutputFormat, findings_as, in_repository
from rarms_iac.views.json_output import json_of
from rarms_iac.views.markdown import ITEM, LINE, ROW, code, finding_parts, fitting, folded, plain_line, safe
from rarms_iac.views.plan import plan_summary, plan_text
from rarms_iac.views.scripts import difference_text

if TYPE_CHECKING:
    from rich.console import RenderableType

LONGEST_COMMENT = 65_536
"""Characters that GitHub takes."""

_RISKS, _TABLE, _SCRIPTS, _STEPS, _LOGS = 10_000, 10_000, 10_000, 6_000, 3_000
"""Characters of the parts; together with findings, heads and ends they stay below the longest comment."""


def plan_as(
    form: OutputFormat, plan: Plan, manifest: Manifest, *, verbose: bool, review: Callable[[], PlanReview]
) -> "RenderableType":
    """Give a plan that form: text to be laid out, or else the text itself.

    Args:
        form: SARIF, JUnit and GitHub have the plan's findings, Markdown is the comment of a pull request.
        plan: what is shown.
        manifest: that findings point into.
        verbose: show every attribute and reason in the text, too.
        review: what only the comment needs; it is asked at most once.
    """
    match form:
        case OutputFormat.TEXT:
            return plan_text(plan, sources=manifest.sources, verbose=verbose)
        case OutputFormat.JSON:
            return json_of(plan)
        case OutputFormat.MARKDOWN:
            return comment(review())
        case _:
            return findings_as(form, plan.findings, manifest.sources, places=manifest.places, accepted=plan.accepted)


def is_for_findings(form: OutputFormat) -> bool:
    """Whether the form has something to say where there is no plan; text and JSON say that on their own."""
    return form not in {OutputFormat.TEXT, OutputFormat.JSON}


def no_plan_as(form: OutputFormat, *, manifest: str, error: UseCaseError, places: Places) -> "RenderableType":
    """Give the reasons why there is no plan that form."""
    if form is OutputFormat.MARKDOWN:
        return failure_comment(manifest, error.findings)
    return findings_as(form, error.findings, error.sources, places=places)


def marker(manifest: str) -> str:
    """The hidden first line by which a later run finds the comment of this manifest, to update it."""
    return f"<!-- rarms plan: {plain_line(manifest).replace('--', '- -')} -->"


def comment(review: PlanReview) -> str:
    """The whole comment, shorter than `LONGEST_COMMENT`, with a line end."""
    plan = review.plan
    files = " with ".join(map(code, (plan.manifest, *plan.overlays)))
    parts = [
        marker(plan.manifest),
        f"### rarms plan: {safe(plan.application)}\n\n**{safe(plan_summary(plan))}**",
        *_risks(review),
        *finding_parts(in_repository(plan.findings)),
        *_table(plan),
        *_logs(review),
        *_scripts(review),
        f"<sub>Plan {plan.id} of {files}, by rarms {plan.rarms_version}. Nothing was applied.</sub>",
    ]
    text = "\n\n".join(parts) + "\n"
    assert len(text) < LONGEST_COMMENT, "each part has its share of it"
    return text


def failure_comment(manifest: str, findings: Sequence[Diagnostic]) -> str:
    """The comment where there is no plan: why."""
    errors = sum(finding.severity is Severity.ERROR for finding in findings)
    head = f"### rarms plan: there is none\n\n**{counted(errors, 'error')} to correct first.**"
    return "\n\n".join([marker(manifest), head, *finding_parts(in_repository(findings))]) + "\n"


def _downtimes(part: HostPlan) -> Iterator[tuple[str, str | None]]:
    """Each partition that stops on a host, and for how long; None: it stays off until it is started.

    Steps are done one after another: between a stop and the start that belongs to it others may be stopped, too.
    """
    for at, step in enumerate(part.steps):
        if not isinstance(step.operation, StopPartition):
            continue
        name = step.operation.partition
        later = part.steps[at:]
        starts = [n for n, each in enumerate(later) if isinstance(each.operation, StartPartition)]
        end = next((n for n in starts if later[n].address.partition == name), None)
        if end is None:
            yield name, None
            continue
        graces = sum(each.operation.grace_ms for each in later[:end] if isinstance(each.operation, StopPartition))
        others = starts.index(end)
        of_others = f", after {counted(others, 'start')} of others" if others else ""
        yield (
            name,
            f"for at most {show_milliseconds(graces)} of shutdown, and then as long as its start takes{of_others}",
        )


def _risks(review: PlanReview) -> Iterator[str]:
    plan = review.plan
    kinds = (_stops, _removals, _shrinks, _later_effects)
    changes = [line for risks_of in kinds for part in plan.hosts for line in risks_of(part)]
    lines = [*_without_risk(plan, changes), *changes]
    if review.headrooms:
        lines.append(f"- **Least headroom:** {_headroom(review.headrooms[0])}")
    yield "#### Risk\n\n" + "\n".join(fitting(lines, _RISKS, ITEM, "more"))
    if len(review.headrooms) > 1:
        rows = [f"- {_headroom(headroom)}" for headroom in review.headrooms]
        yield folded(f"Headroom of each APT ({len(rows)})", fitting(rows, _LOGS, ITEM, "more"))
    yield "#### Taking it back\n\n" + "\n".join(fitting(list(_undo(plan)), _LOGS, ITEM, "more"))


def _without_risk(plan: Plan, changes: Sequence[str]) -> Iterator[str]:
    """What a reader who looks for a risk and finds none may rely on."""
    if not any(part.steps for part in plan.hosts):
        yield "- Nothing changes on the hosts."
    elif not changes:
        yield "- Nothing stops, shrinks or is removed."
    elif not any(isinstance(step.operation, StopPartition) for part in plan.hosts for step in part.steps):
        yield "- Nothing stops."


def _stops(part: HostPlan) -> Iterator[str]:
    removed = {change.address.partition for change in part.changes if isinstance(change, Delete)}
    for partition, duration in _downtimes(part):
        if partition not in removed:
            time = duration or "and stays off until it is started"
            yield f"- **Stops:** {_name(partition, part)} on {safe(part.host.name)}, {time}."


def _removals(part: HostPlan) -> Iterator[str]:
    for change in part.changes:
        if isinstance(change, Delete) or change.action == "replace":
            yield f"- **Removed:** {_place(change, part)}, {safe(describe_disruption(change) or 'removed')}."
    for step in part.steps:
        if isinstance(step.operation, RemoveDisk):
            yield f"- **Deletes a disk:** {code(step.operation.path)} on {safe(part.host.name)}."


def _shrinks(part: HostPlan) -> Iterator[str]:
    for change in part.changes:
        lower = [f"{name} {old} → {new}" for name, old, new in _lower_settings(change)]
        if lower:
            yield f"- **Shrinks:** {_place(change, part)}, {', '.join(lower)}."


def _later_effects(part: HostPlan) -> Iterator[str]:
    for change in part.changes:
        if change.disruption is Disruption.HOST_RESTART:
            yield f"- **Takes effect when the host starts again:** {_place(change, part)}."
    for held in part.held_back:
        yield f"- **Held back, not in the plan:** {_place(held.change, part)}, {safe(held.why)}"


def _place(change: Change, part: HostPlan) -> str:
    return f"{safe(str(change.address))} on {safe(part.host.name)}"


def _lower_settings(change: Change) -> Iterator[tuple[str, str, str]]:
    """What a partition is promised less of; a weight promises nothing, it only shares out what is not reserved."""
    old, new = _settings_of(change) or (None, None)
    if old is None or new is None:
        return
    before, after = guaranteed(old.reserve, old.processors), guaranteed(new.reserve, new.processors)
    if after < before:
        yield "reserve", show_processors(before), show_processors(after)
    if new.limit * new.processors < old.limit * old.processors:
        old_limit, new_limit = (guaranteed(each.limit, each.processors) for each in (old, new))
        yield "limit", show_processors(old_limit), show_processors(new_limit)
    if new.memory < old.memory:
        yield "memory", write_bytes(old.memory), write_bytes(new.memory)


def _headroom(headroom: AptHeadroom) -> str:
    index = index_named(headroom.index)
    share = "unbounded" if headroom.share == float("inf") else f"{100 * headroom.share:.0f} %"
    return (
        f"{headroom.index} of {safe(headroom.component)} must be {safe(show_threshold(index, headroom.threshold))}; "
        f"by its data log it is {safe(show_value(index, headroom.expected))} at worst with the reserve of this plan: "
        f"{share} of the threshold to spare."
    )


def _undo(plan: Plan) -> Iterator[str]:
    lasting = [step for part in plan.hosts for step in part.steps if step.undo.level is not UndoLevel.FULL]
    yield (
        "`rarms undo` takes the whole plan back after it was applied"
        + (f", but for {counted(len(lasting), 'step')}:" if lasting else ".")
    )
    for step in lasting:
        level = "in part" if step.undo.level is UndoLevel.PARTIAL else "not at all"
        yield f"- {safe(str(step.address))}, {safe(step.title)}: {level}; {safe(step.undo.message)}"
    again = [safe(name) for part in plan.hosts for name, duration in _downtimes(part) if duration is not None]
    if again:
        yield f"- The undo stops {in_a_row(again)} again, for as long as above."


def _table(plan: Plan) -> Iterator[str]:
    rows = [row for part in plan.hosts for row in _rows(part)]
    if rows:
        head = (
            "| | partition | host | reserve before (of the host) | after | memory before | after | also |\n"
            "|---|---|---|--:|--:|--:|--:|---|"
        )
        yield "#### Partitions before and after\n\n" + "\n".join([head, *fitting(rows, _TABLE, ROW, "more partitions")])
    others = [
        f"- `{SYMBOLS[change.action]}` {safe(str(change.address))} on {safe(part.host.name)}"
        for part in plan.hosts
        for change in part.changes
        if not _settings_of(change)
    ]
    if others:
        yield folded(f"{counted(len(others), 'other change')}", fitting(others, _LOGS, ITEM, "more"))


def _rows(part: HostPlan) -> Iterator[str]:
    for change in part.changes:
        settings = _settings_of(change)
        if settings:
            before, after = settings
            cells = [
                f"`{SYMBOLS[change.action]}`",
                _name(change.address.partition, part),
                safe(part.host.name),
                *(_reserve(each, part) for each in (before, after)),
                *("" if each is None else write_bytes(each.memory) for each in (before, after)),
                ", ".join(_other_attributes(change, part)),
            ]
            yield f"| {' | '.join(cells)} |"


def _other_attributes(change: Change, part: HostPlan) -> Iterator[str]:
    """What an update changes beside the columns of the table."""
    if isinstance(change, Update):
        for attribute in attributes_of(change, part.facts):
            if attribute.differs and attribute.name not in {"reserve", "memory"}:
                yield f"{safe(attribute.name)} {safe(attribute.before or '')} → {safe(attribute.after or '')}"


def _settings_of(change: Change) -> tuple[PartitionSettings | None, PartitionSettings | None] | None:
    before = None if isinstance(change, Create) else change.before
    after = None if isinstance(change, Delete) else change.after
    if not isinstance(before or after, Partition):
        return None
    return (
        before.settings if isinstance(before, Partition) else None,
        after.settings if isinstance(after, Partition) else None,
    )


def _reserve(settings: PartitionSettings | None, part: HostPlan) -> str:
    if settings is None:
        return ""
    processors, whole = guaranteed(settings.reserve, settings.processors), part.facts.logical_processors
    share = share_of_host(processors, whole, safe(part.name))
    return f"{show_processors(processors)} ({share})" if share else show_processors(processors)


def _name(partition: str, part: HostPlan) -> str:
    members = part.components.get(partition, ())
    inside = f" ({', '.join(map(safe, members))})" if members and members != (partition,) else ""
    return f"{safe(partition)}{inside}"


def _logs(review: PlanReview) -> Iterator[str]:
    if review.logs:
        head = "| data log | CR before (of each virtual processor) | after |\n|---|--:|--:|"
        uses = [[f"{use} %" if isinstance(use, int) else use for use in (log.before, log.after)] for log in review.logs]
        rows = [f"| {code(log.path)} | {' | '.join(use)} |" for log, use in zip(review.logs, uses, strict=True)]
        yield "#### Data logs\n\n" + "\n".join([head, *fitting(rows, _LOGS, ROW, "more data logs")])


def _scripts(review: PlanReview) -> Iterator[str]:
    lines: list[str] = []
    for name, change in review.scripts.items():
        text = "" if change.is_empty else render(difference_text(replace(change, old="the base", new=name)), UNLIMITED)
        lines += [plain_line(line, indent=True) for line in text.splitlines()]
    lines += [f"{plain_line(name)}: the base has no such script" for name in review.new_scripts]
    if lines:
        yield folded("What changed in the scripts", ["```text", *fitting(lines, _SCRIPTS, LINE, "more lines"), "```"])
    steps = [line for part in review.plan.hosts for line in _steps(part)]
    if steps:
        has_scripts = any(part.host.provider is not ProviderKind.LINUX for part in review.plan.hosts)
        why = (
            [f"Scripts are not compared: {safe(review.without_base)}.", ""]
            if review.without_base and has_scripts
            else []
        )
        body = [*why, "```text", *fitting(steps, _STEPS, LINE, "more steps"), "```"]
        number = sum(len(part.steps) for part in review.plan.hosts)
        yield folded(counted(number, "step") + ", in order", body)


def _steps(part: HostPlan) -> Iterator[str]:
    if part.steps:
        yield f"Host {plain_line(part.host.name)}"
        for number, step in enumerate(part.steps, 1):
            yield f"{number}. {plain_line(f'{step.address}: {step.title}')}"
