"""What a server adds to the report's page: hosts, components, what can be done, the plan, and history, for a template.

It shows what the use cases said, with boxes for what a terminal asks or takes as options. It decides which forms can be
used now: one that finishes a run, or starts what a measurement stopped, only where that is left and no use case runs.
"""

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, fields, replace
from fractions import Fraction
from types import MappingProxyType

from rarms_iac.app.applying import changed_manifest
from rarms_iac.app.report_model import Report
from rarms_iac.app.requests import STOP_PARTITIONS, ManifestSource, Option
from rarms_iac.app.scripts import ScriptSince
from rarms_iac.app.status import HostOverview, NextCommand
from rarms_iac.applying.refusals import describe_missing_journal
from rarms_iac.manifest.load import manifest_path
from rarms_iac.measuring.measure_request import MeasureRequest
from rarms_iac.measuring.prove import ProveRequest
from rarms_iac.measuring.tune import TuneRequest
from rarms_iac.model.commands import PLAN, START, RecommendedCommand, sentences
from rarms_iac.model.diagnostics import Diagnostic, Sources
from rarms_iac.model.indexes import index_named
from rarms_iac.model.journal import RunKind
from rarms_iac.studio.actions import Workspace
from rarms_iac.studio.knowledge import LOOK_SECONDS, Knowledge, is_followed
from rarms_iac.texts.indexes import show_threshold
from rarms_iac.texts.messages import in_a_row, natural_order
from rarms_iac.texts.quantities import show_processors
from rarms_iac.views.console import UNLIMITED, plain_text, render
from rarms_iac.views.plan import plan_text
from rarms_iac.views.reports.html import render_page
from rarms_iac.views.reports.tables import levels_of_component
from rarms_iac.views.scripts import difference_text
from rarms_iac.views.status import RUNS, describe_holders, describe_totals, history_rows, partitions_table
from rarms_iac.views.table import Column, Table, show_cell
from rarms_iac.views.verdicts import describe_verdicts_of


@dataclass(frozen=True, slots=True, kw_only=True)
class PlanOnPage:
    """The plan that was made last on the page."""

    id: str
    text: str  # as a terminal shows it
    details: str  # with --verbose: every attribute, reason and step, too
    command: RecommendedCommand  # that makes such a plan and does it
    is_made_anew: bool  # by that command, of a manifest that has changed: what it does is not this plan
    scripts: tuple[tuple[str, str, str, str], ...]  # name, text, plan that was applied last, difference to it
    can_be_applied: bool
    changed: tuple[str, ...]  # that the manifest or a host has changed since


def plan_on_page(known: Knowledge, workspace: Workspace, manifest_options: str) -> PlanOnPage | None:
    """Show the plan that was made last on the page.

    Returns:
        None: there is none, or it was applied there.
    """
    plan = workspace.plan
    if plan is None:
        return None
    changes = changed_manifest(plan, workspace.source)
    notes = [plain_text(sentences(note.detail, note.advice), manifest_options) for note in changes]
    hosts = known.overview.hosts if known.overview else ()
    serials = {host.name: host.compared.serial for host in hosts if host.compared}
    moved = [part.name for part in plan.hosts if serials.get(part.name, part.serial) != part.serial]
    if moved:
        notes.append(f"{in_a_row(moved)} changed since this plan was made. Plan again.")
    return PlanOnPage(
        id=plan.id,
        text=render(plan_text(plan, sources=known.sources), UNLIMITED, manifest=manifest_options),
        details=render(plan_text(plan, sources=known.sources, verbose=True), UNLIMITED, manifest=manifest_options),
        scripts=tuple(_script(since) for since in workspace.scripts),
        command=workspace.does,
        is_made_anew=bool(changes),
        can_be_applied=any(part.steps for part in plan.hosts) and not moved,
        changed=tuple(notes),
    )


def _script(since: ScriptSince) -> tuple[str, str, str, str]:
    difference = "" if since.difference is None else render(difference_text(since.difference), UNLIMITED)
    return since.script.name, since.script.text, since.applied, difference


@dataclass(frozen=True, slots=True, kw_only=True)
class StudioSettings:
    """The settings of the studio: what it serves, and how."""

    source: ManifestSource
    manifest_options: str = ""  # what recommended commands end with, such as ` -f cell`
    port: int = 0  # 0: any that is free
    read_only: bool = False


@dataclass(frozen=True, slots=True, kw_only=True)
class Box:
    """A question that a box answers with yes."""

    name: str  # of the action's field
    flag: str  # the option that says the same in a terminal
    label: str
    excludes: str = ""  # fields that cannot be asked together with it


@dataclass(frozen=True, slots=True, kw_only=True)
class BarPart:
    """A part of a host's bar, in per cent of its logical processors."""

    kind: str  # class of the drawing: used, foreign, kept
    start: str
    width: str
    title: str


@dataclass(frozen=True, slots=True, kw_only=True)
class HostOnPage:
    """A host as the page has it."""

    name: str
    sentence: str
    parts: tuple[BarPart, ...]
    partitions: Table | None  # None: it could not be looked at, or has none
    problems: tuple[str, ...]
    remark: str  # when it was looked at, where not each change is noticed; else empty


@dataclass(frozen=True, slots=True, kw_only=True)
class ComponentOnPage:
    """A component as the page has it."""

    name: str
    criticality: int
    apt: tuple[str, ...]
    reserve: str  # in LPs
    share: str  # of its processors
    verdicts: tuple[str, ...]  # or why nothing is known


LABELS = {
    "stop_partitions": "Stop the application's partitions while measuring",
    "on_busy_host": "Measure while other work runs on the host",
    "weak_load": "Accept loads that leave processors idle",
    "dry_run": "Do not change the manifest",
    "load_host": "Allow full load on the hosts",
    "without_load": "Prove without load",
}
COARSE = Box(
    name="coarse", flag="--interactive", label="A coarse curve, to choose a level from", excludes="first last step"
)


def _box(name: str, option: Option, excludes: str = "") -> Box:
    return Box(name=name, flag=option.flags[0], label=LABELS[name], excludes=excludes)


def _boxes(request: type, *names: str) -> Iterator[Box]:
    """Yield the boxes of these fields of a request, which are options."""
    options = {field.name: field.metadata.get("option") for field in fields(request)}
    for name in names:
        option = options[name]
        assert isinstance(option, Option), "only fields that are options have boxes"
        yield _box(name, option)


def _boxes_of_running(request: type) -> tuple[Box, Box]:
    """Return the boxes for partitions that run meanwhile: they are stopped, or left."""
    busy = next(_boxes(request, "on_busy_host"))
    stop = _box("stop_partitions", STOP_PARTITIONS, excludes=busy.name)
    return stop, replace(busy, excludes=stop.name)


MEASURE_BOXES = (COARSE, *_boxes_of_running(MeasureRequest), *_boxes(MeasureRequest, "weak_load"))
TUNE_BOXES = (*_boxes_of_running(TuneRequest), *_boxes(TuneRequest, "dry_run"))
PROVE_BOXES = tuple(_boxes(ProveRequest, "load_host", "without_load"))


@dataclass(frozen=True, slots=True, kw_only=True)
class StudioOnPage:
    """Everything that a server adds."""

    version: str  # of what the page shows, as the server sends it when it changes
    application: str
    read_only: bool
    manifest_options: str
    hosts: tuple[HostOnPage, ...]
    components: tuple[ComponentOnPage, ...]
    is_running: bool  # a use case of this page
    held: str  # which runs of others hold hosts now; empty: none that can be seen
    next_command: NextCommand | None
    unfinished: bool  # a run on a host did not end
    left_by_measurement: bool  # a measurement did not end
    forms_by_verb: Mapping[str, str]  # by verb of a recommended command, the form that does the same
    plan: PlanOnPage | None
    plan_is_next: bool
    history: Table
    can_undo: bool
    has_manifest: bool
    measure_boxes: tuple[Box, ...] = MEASURE_BOXES
    tune_boxes: tuple[Box, ...] = TUNE_BOXES
    prove_boxes: tuple[Box, ...] = PROVE_BOXES


FORMS = MappingProxyType(
    {**{verb: verb for verb in ("measure", "tune", "plan", "prove")}, "start": "plan-start", "apply": "finish"}
)


def page_of(
    known: Knowledge, workspace: Workspace, settings: StudioSettings, *, version: str, is_running: bool
) -> bytes:
    """Make the page of what is known.

    Args:
        workspace: the plan that was made last.
        is_running: whether a use case runs: what it needs on a host for a while is not left by another one.

    Returns:
        HTML in UTF-8.
    """
    report = _report(known, workspace)
    overview = known.overview
    hosts = overview.hosts if overview else ()
    unfinished = any(host.is_unfinished for host in hosts) and not is_running
    is_cut_off = any(host.is_left_by_measurement for host in hosts) and not is_running
    forms = {
        verb: form
        for verb, form in FORMS.items()
        if (form != "finish" or unfinished) and (form != "plan-start" or is_cut_off)
    }
    runs_by_host = known.history.hosts if known.history else {}
    plan = plan_on_page(known, workspace, settings.manifest_options)
    next_command = overview.next_command if overview and not is_running else None
    studio = StudioOnPage(
        version=version,
        application=report.application,
        read_only=settings.read_only,
        manifest_options=settings.manifest_options,
        hosts=tuple(_host_on_page(host, _remark(host.name, known)) for host in hosts),
        components=tuple(_components(known, report)),
        is_running=is_running,
        held="" if is_running else describe_holders(hosts),
        next_command=next_command,
        unfinished=unfinished,
        left_by_measurement=is_cut_off,
        forms_by_verb=forms,
        plan=plan,
        plan_is_next=plan is not None and _is_next(plan, next_command),
        history=Table(
            (Column("host"), *RUNS),
            tuple((host, *row) for host, runs in runs_by_host.items() for row in history_rows(runs)),
        ),
        can_undo=_can_undo(known, report.application),
        has_manifest=known.manifest is not None,
    )
    return render_studio(report, known.findings, known.sources, studio)


def render_studio(report: Report, findings: Sequence[Diagnostic], sources: Sources, studio: StudioOnPage) -> bytes:
    """Fill the template in: HTML in UTF-8."""
    return render_page(
        report,
        findings=findings,
        sources=sources,
        manifest_options=studio.manifest_options,
        style="",
        script="",
        policy="",
        studio=studio,
    )


def _is_next(plan: PlanOnPage, command: NextCommand | None) -> bool:
    """Return whether the next command would make this plan."""
    made_by = START.verb if plan.command == START else PLAN.verb
    return plan.can_be_applied and not plan.changed and command is not None and command.command.verb == made_by


def _can_undo(known: Knowledge, application: str) -> bool:
    """Return whether a host's last run is this application's apply, or its undo that did not end."""
    hosts = known.history.hosts.values() if known.history else ()
    own = [runs[-1] for runs in hosts if runs and runs[-1].application == application]
    return any(run.run is RunKind.APPLY or run.closing is None for run in own)


def _report(known: Knowledge, workspace: Workspace) -> Report:
    """Return an empty one where nothing could be read; without an application it is called as its file."""
    name = known.manifest.system.application.name if known.manifest else manifest_path(workspace.source.manifest)
    return known.report or Report(application=name, description="", measurements=(), capacities=())


def _remark(host: str, known: Knowledge) -> str:
    assert known.manifest is not None, "the label is the host's name"
    if is_followed(known.manifest.system.hosts[host]):
        return ""
    return (
        f"Read at {known.looked_at}. Changes by other tools appear within {LOOK_SECONDS} s if no action "
        "runs here. Locks by other runs are not shown."
    )


def _host_on_page(host: HostOverview, remark: str) -> HostOnPage:
    totals = host.totals
    if totals is None:
        problems = tuple(str(sentences(problem.detail, problem.advice)) for problem in host.problems)
        return HostOnPage(
            name=host.name,
            sentence="could not be read",
            parts=(),
            partitions=None,
            problems=problems,
            remark=remark,
        )
    own = sorted(host.partitions, key=lambda partition: natural_order(partition.name))
    amounts = [("used", partition.reserved_lp, partition.name) for partition in own]
    amounts += [("foreign", totals.unmanaged_lp, "unmanaged partitions")]
    unpromised = ("kept", totals.kept_lp, "kept for the host")
    table = partitions_table(host)
    return HostOnPage(
        name=host.name,
        sentence=describe_totals(totals),
        parts=tuple(_parts([*amounts, unpromised], totals.host_lp)),
        partitions=table if table.rows else None,
        problems=(describe_missing_journal(host.name, host.unrecorded),) if host.unrecorded else (),
        remark=remark,
    )


def _parts(amounts: Sequence[tuple[str, Fraction, str]], processors: int) -> Iterator[BarPart]:
    """Yield reserved parts from the left, and the part kept for the host at the right end."""
    start = Fraction(0)
    for kind, amount, name in amounts:
        if amount > 0:
            width = 100 * amount / processors
            begin = 100 - width if kind == "kept" else start
            title = f"{name}: {show_processors(amount)}"
            yield BarPart(kind=kind, start=f"{float(begin):.3f}", width=f"{float(width):.3f}", title=title)
            start += width


def _components(known: Knowledge, report: Report) -> Iterator[ComponentOnPage]:
    """Yield the most critical first."""
    components = known.manifest.system.components.values() if known.manifest else ()
    for component in sorted(components, key=lambda each: (-each.criticality, natural_order(each.name))):
        table = levels_of_component(report, component.name)
        at = {column.title: number for number, column in enumerate(table.columns)}
        reserves, shares, rows = (
            tuple(dict.fromkeys(show_cell(row[at[title]], table.columns[at[title]].unit) for row in table.rows))
            for title in ("reservation", "CR", "verdict")
        )
        verdicts = tuple(describe_verdicts_of(report.verdicts, component.name)) or rows
        apt = (f"{name} {show_threshold(index_named(name), threshold)}" for name, threshold in component.apt.items())
        yield ComponentOnPage(
            name=component.name,
            criticality=component.criticality,
            apt=tuple(apt),
            reserve=reserves[0] if reserves else "not known",
            share=shares[0] if shares else "",
            verdicts=verdicts or ("it is not in the layout of any host",),
        )
