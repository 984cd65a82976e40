"""Choosing a level of performance: an APT, what reservation follows from it, and the edit of the manifest."""

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from fractions import Fraction
from math import ceil, floor, isfinite
from typing import Literal

from rarms_iac.app.data_logs import measured_reservations
from rarms_iac.app.decision_logs import record_choices
from rarms_iac.app.declared_hosts import states_at_hand
from rarms_iac.app.manifest_files import FileEdit, edit_levels, write_edits
from rarms_iac.app.manifests import Manifest
from rarms_iac.app.requests import argument, flag, option, refuse_unknown
from rarms_iac.app.use_case_errors import Outcome, RequestError, UseCaseError
from rarms_iac.model.commands import Wording, prose
from rarms_iac.model.diagnostics import Diagnostic, has_errors
from rarms_iac.model.host import Host
from rarms_iac.model.indexes import PerformanceIndex, find_index, threshold_of
from rarms_iac.model.layout import Layout, PlacedPartition
from rarms_iac.model.outcomes import WIDTH, Estimate
from rarms_iac.model.output import output
from rarms_iac.model.quantities import UNITS, NotAQuantity, Unit, guaranteed
from rarms_iac.model.seen_host import unseen
from rarms_iac.model.system import Component, System, Threshold
from rarms_iac.model.totals import HostTotals
from rarms_iac.planner.groups import Group, groups_of
from rarms_iac.planner.layout import Planning, plan_layout
from rarms_iac.planner.planning_findings import NOT_MET
from rarms_iac.planner.reservations import MeasuredReservations, depends_on_a_log, names_of
from rarms_iac.planner.sizes import size
from rarms_iac.planner.totals import totals_by_host
from rarms_iac.planner.verdicts import MeasuredTogether, NotMeasured, decide
from rarms_iac.statistics.curves import Curve, Point, holds
from rarms_iac.texts.indexes import show_value
from rarms_iac.texts.messages import in_a_row, quoted, suggestion
from rarms_iac.texts.quantities import plain


@dataclass(frozen=True, slots=True, kw_only=True)
class SelectedLevel:
    """The share of a partition on a platform with which the level holds there."""

    platform: str
    partition: str
    reserve: int  # whole per cent of each virtual processor
    processors: int  # virtual ones
    host: str  # the first of the platform
    measured_below: int  # the next lower reserve that was measured; 0: none was
    expected: Estimate | Point | None  # the index there, and its band; None: not measured there
    interference: str  # the load that asks for most: the value and the reserves are of its log

    @property
    def may_be_less(self) -> bool:
        """Whether a search could find less: nothing close below was measured."""
        return self.reserve - self.measured_below > WIDTH

    @output
    def reserved_lp(self) -> Fraction:
        """What the partition is guaranteed, in LPs."""
        return guaranteed(self.reserve, self.processors)


@dataclass(frozen=True, slots=True, kw_only=True)
class Selection:
    """A level that was chosen, and what follows."""

    kind: Literal["selection"] = "selection"
    component: str
    index: str
    unit: str  # of the levels
    before: Threshold | None
    after: Threshold
    levels: tuple[SelectedLevel, ...]  # by platform
    depends_on_a_log: bool  # else the manifest fixes the reserve
    totals: Mapping[str, HostTotals]  # by host; none without a layout
    why_no_headroom: str
    findings: tuple[Diagnostic, ...]
    file: str = ""  # of the manifest, with the level; empty: nothing was written


@dataclass(frozen=True, slots=True, kw_only=True)
class LevelProposal:
    """Levels that were chosen together; nothing is written yet."""

    selections: tuple[Selection, ...]  # what follows from all of them, a level each
    edits: tuple[FileEdit, ...]  # what writing them changes, a file of the manifest each
    changed: Manifest  # with the levels


class BeyondMeasured(UseCaseError):
    """No measured reservation is enough for a level, and the host can give more.

    Attributes:
        first: the lowest CR that was not measured, in whole per cent.
        last: the highest that the host can give.
    """

    def __init__(self, problem: UseCaseError, first: int, last: int) -> None:
        super().__init__(problem.outcome, problem.findings, problem.sources)
        self.first = first
        self.last = last


FAR = 10
"""So many times worse than the worst that was measured is not a level that a user wants."""


Loads = tuple[MeasuredTogether, ...]
"""The data logs of a partition on a host, one for each load: a level holds if it holds under each."""


def _advice_beyond(choice: "_Choice", host: Host, loads: Loads) -> Wording:
    """Return the levels that can be chosen now and the measurement for more, where nothing measured is enough."""
    higher, limit = _not_measured_yet(choice, host, loads), _limit(loads[0], host)
    easiest = _easiest(choice, loads)
    if higher is None:
        return f"Choose an easier level{easiest}. The component can have at most {limit} % of its VPs."
    first, last = higher
    return prose(
        f"Choose an easier level{easiest}. Or measure higher settings, and select again: ",
        loads[0].again.also(from_=f"{first}%", to=f"{last}%"),
        ".",
    )


def _easiest(choice: "_Choice", loads: Loads) -> str:
    """Name the best level that holds under every load as it was measured, with its CR; empty: none is known."""
    name, index = choice.component.name, choice.index
    safe = [log.curves(name, index.name).safe_value_at(log.measured[-1]) for log in loads]
    known = [value for value in safe if value is not None and isfinite(value)]
    if len(known) < len(loads):
        return ""
    level = _show_level(index, (max if index.smaller_is_better else min)(known))
    with_level = replace(choice.component, apt={index.name: threshold_of(index, level)})
    reserve = decide([with_level], loads).verdict.reserve
    if reserve is None:
        return ""
    load_suffix = " under each load" if len(loads) > 1 else ""
    return f": {level} holds with {reserve} % of its VPs{load_suffix}"


def _not_measured_yet(choice: "_Choice", host: Host, loads: Loads) -> tuple[int, int] | None:
    """Return the first and last CR to measure for the level.

    None means that with some load not even the whole host is enough.
    """
    curves = [(log.measured[-1], log.curves(choice.component.name, choice.index.name)) for log in loads]
    highest = [top for top, curve in curves if not holds(curve, choice.threshold, top)] or [top for top, _ in curves]
    limit = _limit(loads[0], host)
    return None if max(highest) >= limit else (min(highest) + 1, limit)


def _limit(log: MeasuredTogether, host: Host) -> int:
    """Return the highest CR that the host can give."""
    return min(100, int(100 * unseen(host).capacity.processors / log.processors))


def _why_far(index: PerformanceIndex, threshold: Threshold, text: str, curves: Sequence[Curve]) -> str:
    """Return the reason against the level, with plausible levels; empty if it is plausible or nothing was measured.

    A share cannot lie far from another.
    """
    values = [point.value for curve in curves for point in curve.points if isfinite(point.value) and point.value > 0]
    if not values or index.unit is Unit.SHARE:
        return ""
    easiest, level = (max if index.smaller_is_better else min)(values), float(threshold.value)
    times = level / easiest if index.smaller_is_better else easiest / level if level else float("inf")
    if times <= FAR:
        return ""
    lowest, highest = show_value(index, min(values)), show_value(index, max(values))
    return (
        f"{text} is far outside the measured range of {index.name}, {lowest} to "
        f"{highest}.{_suggest_unit(index, text, values)} If it is correct, write it into the manifest."
    )


def _suggest_unit(index: PerformanceIndex, text: str, values: Sequence[float]) -> str:
    """Ask whether another unit was meant, where the number in that unit lies among what was measured; else empty."""
    number = Fraction(text.rstrip("abcdefghijklmnopqrstuvwxyz/ "))
    for unit, factor in UNITS[index.unit].items():
        if min(values) / 2 <= float(number * factor) <= max(values) * 2:
            return f" Did you mean {plain(number)} {unit}?"
    return ""


def _show_level(index: PerformanceIndex, value: float) -> str:
    """Return rounded to the side on which it still holds."""
    tenths = ceil(value * 10) if index.smaller_is_better else floor(value * 10)
    return show_value(index, Fraction(tenths, 10))


@dataclass(frozen=True, slots=True, kw_only=True)
class SelectRequest:
    """A level of performance that is good enough for a component."""

    component: str = argument()
    level: str = option("--at", metavar="LEVEL", help='The threshold: "100 ms", "95 %", "24 /s".', required=True)
    index: str | None = option("--index", metavar="INDEX", help="The performance index, if the level fits several.")
    dry_run: bool = flag("--dry-run", help="Show the result without writing it.")


@dataclass(frozen=True, slots=True, kw_only=True)
class _Choice:
    """A level of one index of one component."""

    component: Component
    index: PerformanceIndex
    text: str  # as given: 100 ms
    threshold: Threshold


def select_level(manifest: Manifest, request: SelectRequest) -> Selection:
    """Choose the performance that is good enough for a component, and write it into the manifest as its APT.

    Comments of the manifest stay; what an overlay says is changed there. The reservation that follows is recorded in
    the configuration log.

    Args:
        manifest: Its file is written, unless it is a dry run.

    Returns:
        The reservation that follows from what was measured, and what is left on the hosts.

    Raises:
        RequestError: no such component or index, the level fits none or several of its indexes, or it lies
            so far from what was measured that it must be a slip.
        UseCaseError: No measured reservation meets the level, or no data log is valid (negative); the file cannot be
            written (failed).
    """
    proposal = propose_levels(manifest, [request])
    [selection], [edit] = proposal.selections, proposal.edits
    if request.dry_run:
        return selection
    write_levels(proposal)
    return replace(selection, file=edit.file)


def propose_levels(manifest: Manifest, requests: Sequence[SelectRequest]) -> LevelProposal:
    """Work out what follows from levels that hold together: the planner sees all of them.

    Args:
        requests: A level each; whether they are dry runs is not looked at.

    Returns:
        What follows, and the edits that write the levels.

    Raises:
        RequestError: As of `select_level`.
        UseCaseError: No measured reservation meets one of the levels, or no data log is valid (negative).
    """
    choices = [_choice_of(manifest.system, each.component, each.level, each.index) for each in requests]
    system = manifest.system
    for choice in choices:
        system = _with_level(system, choice)
    changed = replace(manifest, system=system)
    edits = edit_levels(manifest, [(choice.component, choice.index, choice.text) for choice in choices])
    selections = tuple(_selection(changed, choice) for choice in choices)
    return LevelProposal(selections=selections, edits=edits, changed=changed)


def write_levels(proposal: LevelProposal) -> None:
    """Write levels into the manifest, all of them or none, and record in the configuration log what follows.

    Raises:
        RequestError: A file of the manifest was changed meanwhile.
        UseCaseError: It cannot be written (failed).
    """
    write_edits(proposal.edits)
    names = dict.fromkeys(selection.component for selection in proposal.selections)
    record_choices(proposal.changed, tuple(names))


def _choice_of(system: System, name: str, at: str, index: str | None) -> _Choice:
    refuse_unknown([name], system.components, "component")
    component = system.components[name]
    if index is not None:
        known_index = find_index(index)
        if known_index is None:
            raise RequestError(
                f"The performance index {quoted(index)} is unknown.{suggestion(index, tuple(component.apt))}"
            )
        return _choice(component, known_index, at)
    indexes = [known_index for key in component.apt if (known_index := find_index(key)) is not None]
    if not indexes:
        raise RequestError(f"{name} has no APT yet. Give the index, for example --index mean_response_time.")
    fitting = [known_index for known_index in indexes if _fits(known_index, at)]
    if len(fitting) > 1:
        named = ", ".join(f"--index {known_index.name}" for known_index in fitting)
        raise RequestError(f"{at} fits several indexes of {name}. Give one: {named}.")
    return _choice(component, fitting[0] if fitting else indexes[0], at)


def _choice(component: Component, index: PerformanceIndex, at: str) -> _Choice:
    try:
        threshold = threshold_of(index, at)
    except NotAQuantity as problem:
        units = in_a_row(problem.units, "or")
        raise RequestError(f"{index.name}: {quoted(at)} is not a number with the unit {units}.") from None
    return _Choice(component=component, index=index, text=at, threshold=threshold)


def _fits(index: PerformanceIndex, at: str) -> bool:
    try:
        threshold_of(index, at)
    except NotAQuantity:
        return False
    return True


def _selection(manifest: Manifest, choice: _Choice) -> Selection:
    """Work out what follows from the choice, with the level in the manifest."""
    system, name = manifest.system, choice.component.name
    states = states_at_hand(manifest)
    reservations = measured_reservations(manifest, states)
    group = next((group for group in groups_of(system) if name in names_of(group.members)), None)
    logs = () if group is None else tuple(_logs(group, system, reservations))
    _refuse_far(choice, logs)
    planning = plan_layout(system, reservations, states, manifest.places)
    answer = planning.answer
    levels = () if group is None else tuple(_levels(group, system, reservations, choice))
    if group is not None and depends_on_a_log(group) and not levels:
        addresses = {f"component/{member.name}" for member in group.members} | {f"partition/{group.name}"}
        reasons = [finding for finding in planning.findings if finding.address in addresses]
        findings = [_with_next_command(finding, logs, choice) for finding in reasons or planning.findings]
        problem = UseCaseError(Outcome.NEGATIVE, findings, manifest.sources)
        for host, loads in logs[:1]:
            higher = _not_measured_yet(choice, host, loads)
            if higher is not None and any(finding.code == NOT_MET.code for finding in findings):
                raise BeyondMeasured(problem, *higher)
        raise problem
    return Selection(
        component=name,
        index=choice.index.name,
        unit=choice.index.symbol,
        before=choice.component.apt.get(choice.index.name),
        after=choice.threshold,
        levels=levels,
        depends_on_a_log=group is not None and depends_on_a_log(group),
        totals=totals_by_host(system, answer.partitions, states) if isinstance(answer, Layout) else {},
        why_no_headroom=_why_no_layout(planning),
        findings=() if has_errors(planning.findings) else planning.findings,
    )


def _logs(group: Group, system: System, reservations: MeasuredReservations) -> Iterator[tuple[Host, Loads]]:
    """Yield the data logs of each host where each load's has settings, hosts in name order."""
    for _, host in sorted(system.hosts.items()):
        loads = reservations.log_of_each_load(group.members, host)
        if loads and all(log.measured for log in loads):
            yield host, loads


def _with_next_command(finding: Diagnostic, logs: Sequence[tuple[Host, Loads]], choice: _Choice) -> Diagnostic:
    """Replace the advice of a search: it looks for the manifest's level, and this one is not there yet."""
    if finding.code != NOT_MET.code or not logs:
        return finding
    return replace(finding, advice=prose(_advice_beyond(choice, *logs[0])))


def _refuse_far(choice: _Choice, logs: Sequence[tuple[Host, Loads]]) -> None:
    """Refuse a slip such as `120 s` for `120 ms`, which any reservation would meet."""
    curves = [log.curves(choice.component.name, choice.index.name) for _, loads in logs for log in loads]
    message = _why_far(choice.index, choice.threshold, choice.text, curves)
    if message:
        raise RequestError(f"{choice.component.name}: {message}")


def _with_level(system: System, choice: _Choice) -> System:
    component = system.components[choice.component.name]
    apt: Mapping[str, Threshold] = {**component.apt, choice.index.name: choice.threshold}
    return replace(system, components={**system.components, component.name: replace(component, apt=apt)})


def _levels(
    group: Group, system: System, reservations: MeasuredReservations, choice: _Choice
) -> Sequence[SelectedLevel]:
    """Yield the partition's share on each platform that it was measured for; hosts in the order of their names."""
    levels: dict[str, SelectedLevel] = {}
    for _, host in sorted(system.hosts.items()):
        if host.platform in levels or not group.may_run_on(host.name):
            continue
        sized = size(group, host, reservations)
        log = reservations.log(group.members, host)
        if not isinstance(sized, PlacedPartition) or isinstance(log, NotMeasured):
            continue
        curve = log.curves(choice.component.name, choice.index.name)
        levels[host.platform] = SelectedLevel(
            platform=host.platform,
            partition=group.name,
            reserve=sized.settings.reserve,
            processors=sized.settings.processors,
            host=host.name,
            measured_below=log.measured_below(sized.settings.reserve),
            expected=curve.estimate_at(sized.settings.reserve) or curve.value_at(sized.settings.reserve),
            interference=log.interference,
        )
    return tuple(levels.values())


def _why_no_layout(planning: Planning) -> str:
    if isinstance(planning.answer, Layout):
        return ""
    return next(
        (
            f"{finding.summary} ({finding.code}). {finding.detail}"
            for finding in planning.findings
            if has_errors([finding])
        ),
        "",
    )
