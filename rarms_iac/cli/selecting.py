"""Choosing a level of performance: an APT, what reservation follows from it, and the line of the manifest to change."""

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from fractions import Fraction
from pathlib import Path

from rarms_iac.app.errors import Outcome, UseCaseError
from rarms_iac.app.manifests import Manifest
from rarms_iac.app.select import HostHeadroom, SelectedLevel, Selection
from rarms_iac.cli.datalogs import Measurements, measured_reservations
from rarms_iac.cli.levels import advice_beyond, far_from
from rarms_iac.manifest.edit.values import set_value
from rarms_iac.model.capacity import capacity_of
from rarms_iac.model.diagnostics import Diagnostic, has_errors
from rarms_iac.model.indexes import PerformanceIndex, find_index, threshold_of
from rarms_iac.model.layout import Layout
from rarms_iac.model.quantities import NotAQuantity
from rarms_iac.model.system import Component, Host, System, Threshold
from rarms_iac.model.wording import suggestion
from rarms_iac.planner.findings import NOT_MET
from rarms_iac.planner.groups import Group, groups_of
from rarms_iac.planner.layout import Planning, plan_layout
from rarms_iac.planner.reservations import MeasuredReservations, MeasuredTogether, NotMeasured, rests_on_a_log
from rarms_iac.planner.sizes import Sized, size


class Unclear(Exception):
    """The words do not say which level of which index is meant; the text says what they could."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Choice:
    """One level of one index of one component."""

    component: Component
    index: PerformanceIndex
    text: str  # as given: 100 ms
    threshold: Threshold


@dataclass(frozen=True, slots=True, kw_only=True)
class Edit:
    """A file of the manifest with the level in it."""

    file: str
    before: str
    after: str


@dataclass(frozen=True, slots=True, kw_only=True)
class Selected:
    """What follows from a choice."""

    selection: Selection
    system: System  # the manifest's, with the level
    findings: tuple[Diagnostic, ...]


def choice_of(system: System, name: str, at: str, index: str | None) -> Choice:
    """The level that is meant.

    Raises:
        Unclear: there is no such component or index, or the level fits none, or several, of its indexes.
    """
    component = system.components.get(name)
    if component is None:
        raise Unclear(f"The manifest has no component {name!r}.{suggestion(name, tuple(system.components))}")
    if index is not None:
        found = find_index(index)
        if found is None:
            raise Unclear(f"There is no performance index {index!r}.{suggestion(index, tuple(component.apt))}")
        return _choice(component, found, at)
    indexes = [found for one in component.apt if (found := find_index(one)) is not None]
    if not indexes:
        raise Unclear(f"{name} has no APT yet: say which index is meant, as in --index mean_response_time.")
    fitting = [one for one in indexes if _fits(one, at)]
    if len(fitting) > 1:
        named = ", ".join(f"--index {one.name}" for one in fitting)
        raise Unclear(f"{name} has several indexes that {at} could be of: say which, {named}.")
    return _choice(component, fitting[0] if fitting else indexes[0], at)


def _choice(component: Component, index: PerformanceIndex, at: str) -> Choice:
    try:
        threshold = threshold_of(index, at)
    except NotAQuantity as problem:
        raise Unclear(f"{index.name}: {problem}.") from None
    return Choice(component=component, index=index, text=at, threshold=threshold)


def _fits(index: PerformanceIndex, at: str) -> bool:
    try:
        threshold_of(index, at)
    except NotAQuantity:
        return False
    return True


def select(choice: Choice, measured: Measurements, manifest: Manifest) -> Selected:
    """What follows from the choice; nothing is written.

    Raises:
        Unclear: the level is so far from what was measured that it must be a slip.
        UseCaseError: no measured reservation meets it, or there is no data log that holds (exit 4).
    """
    system = _with(measured.system, choice)
    changed = replace(measured, system=system)
    reservations = measured_reservations(changed, {})
    group = next((one for one in groups_of(system) if choice.component.name in {m.name for m in one.members}), None)
    logs = () if group is None else tuple(_logs(group, system, reservations))
    _refuse_far(choice, logs)
    planning = plan_layout(system, reservations, {}, manifest.places)
    levels = () if group is None else tuple(_levels(group, system, reservations, choice))
    if group is not None and rests_on_a_log(group) and not levels:
        address = {f"component/{member.name}" for member in group.members} | {f"partition/{group.name}"}
        why = [finding for finding in planning.findings if finding.address in address]
        told = [_leading_on(finding, logs, choice) for finding in why or planning.findings]
        raise UseCaseError(Outcome.NEGATIVE, told, manifest.sources)
    return Selected(
        selection=Selection(
            component=choice.component.name,
            index=choice.index.name,
            before=measured.system.components[choice.component.name].apt.get(choice.index.name),
            after=choice.threshold,
            levels=levels,
            rests_on_a_log=group is not None and rests_on_a_log(group),
            headrooms=_headrooms(planning, system),
            why_no_headroom=_why(planning),
        ),
        system=system,
        findings=() if has_errors(planning.findings) else planning.findings,
    )


def _logs(group: Group, system: System, reservations: MeasuredReservations) -> Iterator[tuple[Host, MeasuredTogether]]:
    """The data log of each host that has one with settings, hosts in name order."""
    for _, host in sorted(system.hosts.items()):
        log = reservations.log(group.members, host)
        if isinstance(log, MeasuredTogether) and log.measured:
            yield host, log


def _leading_on(found: Diagnostic, logs: Sequence[tuple[Host, MeasuredTogether]], choice: Choice) -> Diagnostic:
    """NOTE: a search looks for the manifest's level, and this one is not there yet: that advice would lead nowhere."""
    if found.code != NOT_MET.code or not logs:
        return found
    host, log = logs[0]
    curve = log.curves(choice.component.name, choice.index.name)
    return replace(found, advice=advice_beyond(choice.index, curve, log, host))


def _refuse_far(choice: Choice, logs: Sequence[tuple[Host, MeasuredTogether]]) -> None:
    """NOTE: `120 s` for `120 ms` would be met by any reservation: a slip that nothing else would show.

    Raises:
        Unclear: the level lies far beyond the worst that was ever measured.
    """
    curves = [log.curves(choice.component.name, choice.index.name) for _, log in logs]
    says = far_from(choice.index, choice.threshold, choice.text, curves)
    if says:
        raise Unclear(f"{choice.component.name}: {says}")


def edit_of(choice: Choice, manifest: Manifest) -> Edit:
    """The file that says the level, or is to say it, with the new one; comments stay.

    Raises:
        CannotFormat: its text is no manifest.
    """
    name, index, word = choice.component.name, choice.index.name, choice.index.direction
    is_said = index in choice.component.apt
    path = ("components", name, "apt", index, word)
    file = manifest.places.value(*path).file if is_said else manifest.places.key(*path[:3]).file
    with Path(file).open(encoding="utf-8", newline="") as source:
        before = source.read()
    after = set_value(before, path, choice.text) if is_said else set_value(before, path[:4], {word: choice.text})
    return Edit(file=file, before=before, after=after)


def _with(system: System, choice: Choice) -> System:
    apt: Mapping[str, Threshold] = {**choice.component.apt, choice.index.name: choice.threshold}
    return replace(system, components={**system.components, choice.component.name: replace(choice.component, apt=apt)})


def _levels(
    group: Group, system: System, reservations: MeasuredReservations, choice: Choice
) -> Sequence[SelectedLevel]:
    """What the group gets on each platform that it was measured for; hosts in name order."""
    found: dict[str, SelectedLevel] = {}
    for _, host in sorted(system.hosts.items()):
        if host.platform in found or any(
            member.hosts is not None and host.name not in member.hosts for member in group.members
        ):
            continue
        sized = size(group, host, reservations)
        log = reservations.log(group.members, host)
        if not isinstance(sized, Sized) or isinstance(log, NotMeasured):
            continue
        least = reservations.least(group.members, host)
        found[host.platform] = SelectedLevel(
            platform=host.platform,
            partition=group.name,
            reserve=sized.placed.reserve,
            processors=sized.placed.processors,
            host=host.name,
            host_processors=host.logical_processors,
            interpolated=least is not None and least.interpolated,
            expected=_expected(log, choice, sized.placed.reserve),
        )
    return tuple(found.values())


def _expected(log: MeasuredTogether, choice: Choice, reserve: int) -> tuple[float, float, float] | None:
    point = log.curves(choice.component.name, choice.index.name).value_at(reserve)
    return None if point is None else (point.value, point.lower, point.upper)


def _headrooms(planning: Planning, system: System) -> tuple[HostHeadroom, ...]:
    if not isinstance(planning.answer, Layout):
        return ()
    return tuple(
        HostHeadroom(
            host=name,
            processors=capacity_of(host, None).processors
            - sum(
                (partition.reserved for partition in planning.answer.partitions if partition.host == name), Fraction(0)
            ),
            host_processors=host.logical_processors,
        )
        for name, host in sorted(system.hosts.items())
    )


def _why(planning: Planning) -> str:
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
