"""System -> Layout, or why there is none.

A partition counts whether or not it is to start by itself: its reservation is a promise, and starting it by hand must
not fail because others took its place.
"""

from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from fractions import Fraction
from itertools import takewhile
from typing import Any, assert_never

from rarms_iac.model.commands import MEASURE, RecommendedCommand, Wording, command, prose
from rarms_iac.model.diagnostics import Diagnostic, Facts, Place, Places
from rarms_iac.model.host import Mechanism
from rarms_iac.model.layout import ChosenLayout, Infeasible, Layout, LookedUp, Relaxation, RelaxationKind
from rarms_iac.model.seen_host import SeenHost
from rarms_iac.model.state import USUAL_DEADLINE_PERCENT, State
from rarms_iac.model.system import Disruption, Measured, System
from rarms_iac.planner import planning_findings
from rarms_iac.planner.layout_findings import little_memory, neighbour_findings, other_governor, real_time_findings
from rarms_iac.planner.mechanism import deadline_problems, mechanism_of
from rarms_iac.planner.planning_findings import NOT_PROVEN
from rarms_iac.planner.problem import Problem, by_name, check_layout, problem_of, solve
from rarms_iac.planner.reservations import ReservationSource
from rarms_iac.texts.messages import counted, list_names
from rarms_iac.texts.quantities import show_bytes, show_lp_percent, show_processors


@dataclass(frozen=True, slots=True, kw_only=True)
class Planning:
    """The planner's answer, and what it has to say of it."""

    answer: Layout | Infeasible
    findings: tuple[Diagnostic, ...] = ()


def plan_layout(
    system: System,
    reservations: ReservationSource,
    states: Mapping[str, State],
    places: Places,
    *,
    max_disruption: Disruption | None = None,
    explain: bool = True,
    chosen: ChosenLayout | None = None,
) -> Planning:
    """Place every component in a partition on a host, within what the hosts have, or explain why that is impossible.

    A partition that is on a host stays there, unless removal is allowed; a finding says what a move would gain.

    Args:
        states: the hosts that were looked at, by name; of the others the manifest alone counts.
        places: lines of the manifest, for the findings.
        max_disruption: the most that may be disturbed; `REMOVAL` lets partitions move. None: as the policy says.
        explain: search for the smallest conflict and for ways out, without a layout; otherwise sums alone say why.
        chosen: the layout that is checked instead of a search; None: search.

    Returns:
        A layout; or `Infeasible` with the conflict and ways out. Findings come with both. The solver's work is limited
            by nodes, not by time, so the same input gives the same layout.

    Raises:
        LayoutRefused: the chosen layout does not fit.
    """
    limit = max_disruption or system.policy.max_disruption
    problem = problem_of(system, reservations, states, may_move=limit is Disruption.REMOVAL)
    answer = solve(problem) if chosen is None else check_layout(problem, chosen)
    notes = [
        finding for host in by_name(system.hosts) for finding in smaller_host_findings(problem.seen[host.name], places)
    ]
    if isinstance(answer, Layout):
        notes += _moves(answer, problem, places)
        notes += _remarks(answer, problem, places)
        notes += neighbour_findings(answer, problem, places)
        notes += _deadlines(answer, problem, places)
        notes += real_time_findings(answer, problem, places)
        notes += _placement(answer, places)
    else:
        if not answer.causes and not explain:
            from rarms_iac.planner.infeasibility.causes import explain_by_sums

            answer = explain_by_sums(answer, problem.without_checks())
        elif not answer.causes:
            from rarms_iac.planner.infeasibility.causes import explain_infeasibility
            from rarms_iac.planner.infeasibility.edits import Variant

            may_move = limit is Disruption.REMOVAL
            start = Variant(system=system, states=states, reservations=reservations, may_move=may_move)
            answer = explain_infeasibility(answer, problem.without_checks(), start)
        notes += causes_as_findings(answer, system, places)
    return Planning(answer=answer, findings=tuple(notes))


def causes_as_findings(answer: Infeasible, system: System, places: Places) -> Iterator[Diagnostic]:
    """Report why there is no layout.

    Args:
        answer: the causes; one without advice of its own is advised the ways out.

    Yields:
        A finding for each cause.
    """
    for cause in answer.causes:
        unproven = "" if answer.proven else " The search ended at its limit, so a layout may still exist."
        unsearched: Facts = {"not_searched": answer.unfinished, "node_limit": answer.node_limit}
        limit = unsearched if answer.unfinished else {}
        yield replace(
            cause,
            place=_place(cause, system, places),
            detail=f"{cause.detail}{unproven}",
            advice=cause.advice or prose(describe_ways_out(answer.relaxations), _limit_of_search(answer)),
            values={"proven": answer.proven, **cause.values, **relaxed_levels(answer.relaxations), **limit},
        )


def gather_unmeasured(findings: Sequence[Diagnostic]) -> tuple[Diagnostic, ...]:
    """Replace the findings on components without a measurement: one for each platform, in the place of its first."""
    kinds: dict[object, list[Diagnostic]] = {}
    for number, finding in enumerate(findings):
        is_one = finding.code == planning_findings.UNMEASURED.code and "loads_not_measured" not in finding.values
        kinds.setdefault(finding.values["platform"] if is_one else number, []).append(finding)
    return tuple(alike[0] if len(alike) == 1 else _unmeasured_together(alike) for alike in kinds.values())


def _unmeasured_together(alike: Sequence[Diagnostic]) -> Diagnostic:
    first, components = alike[0], [each.values["components"] for each in alike]
    return planning_findings.UNMEASURED.at(
        first.place,
        "{components} are not measured on {platform} yet.",
        prose("Measure first: ", MEASURE, ". Or set fixed reserves (`cpu.reserve`)."),
        address=first.address,
        components=tuple(name for names in components if isinstance(names, tuple) for name in names),
        platform=first.values["platform"],
        proven=first.values["proven"],
    )


def _limit_of_search(answer: Infeasible) -> str:
    if not answer.unfinished:
        return ""
    limit = f"The search for causes and changes is limited to {answer.node_limit} solver nodes"
    return f"\n{limit}. Not searched to the end: {list_names(answer.unfinished)}."


def relaxed_levels(ways: Sequence[Relaxation]) -> dict[str, Any]:
    """Return the APTs that ways out relax in four rows of equal length: way, component, index and level."""
    levels = [(number, level) for number, way in enumerate(ways, 1) for level in way.levels]
    if not levels:
        return {}
    return {
        "relaxed_ways": tuple(str(number) for number, _ in levels),
        "relaxed_components": tuple(level.component for _, level in levels),
        "relaxed_indexes": tuple(level.index for _, level in levels),
        "relaxed_levels": tuple(level.level for _, level in levels),
    }


def describe_ways_out(ways: Sequence[Relaxation]) -> Wording:
    """Say what would fit, and what may.

    Args:
        ways: out of a layout that does not fit; none: none was found.
    """
    if not ways:
        return "None of the tried changes is enough. Remove a component, or add a host."
    certain = [way for way in ways if way.kind is RelaxationKind.CERTAIN]
    lines: list[Wording] = [f"- {in_a_list(way.changes)}" for way in certain]
    if len(certain) == 1:
        head = (
            "This change would be enough: "
            if len(certain[0].changes) == 1
            else "All of these changes together would be enough:\n  - "
        )
        lines = [head + "\n  - ".join(certain[0].changes) + "."]
    elif certain:
        lines.insert(0, "Each of these changes alone would be enough:")
    first = list(takewhile(lambda way: way.kind is not RelaxationKind.CERTAIN, ways))
    last = [way for way in ways if way.kind is not RelaxationKind.CERTAIN and way not in first]
    lines = [*map(describe_possibility, first), *lines, *map(describe_possibility, last)]
    return prose(lines[0], *(prose("\n", line) for line in lines[1:]))


def in_a_list(changes: Sequence[str]) -> str:
    """Write changes that are needed together.

    Returns:
        A single one as it is, or a heading and a list, one line each.
    """
    return changes[0] if len(changes) == 1 else "\n  - ".join(["all of these:", *changes])


def describe_possibility(way: Relaxation) -> Wording:
    """Return what may be enough, and the command that measures it.

    Args:
        way: one that is not certain.

    Returns:
        A sentence.
    """
    changes = in_a_list(way.changes)
    tunes = [command("tune", host=name) for name in way.hosts] or [command("tune")]
    tune = prose(tunes[0], *(piece for each in tunes[1:] for piece in (" and ", each)))
    match way.kind:
        case RelaxationKind.LOWER_SETTINGS:
            return prose(f"{changes}: ", MEASURE, " may find a smaller reservation.")
        case RelaxationKind.FEWER_PROCESSORS:
            return _checked("Fewer virtual processors may be enough.", MEASURE, way.changes)
        case RelaxationKind.COMBINING:
            return _checked("Combining components may be enough.", tune, way.changes)
        case RelaxationKind.MORE_PROCESSORS:
            return prose(
                f"{changes[:1].upper()}{changes[1:]} may be enough. Measure the partitions there: ",
                MEASURE,
                ".",
            )
        case RelaxationKind.CERTAIN:
            return f"{changes}."
        case _:
            assert_never(way.kind)


def _checked(may_be: str, how: Wording | RecommendedCommand, changes: Sequence[str]) -> Wording:
    if len(changes) == 1:
        return prose(f"{may_be} Check with ", how, f": {changes[0]}.")
    return prose(f"{may_be} Check each of these with ", how, ":\n  - ", "\n  - ".join(changes))


def _place(cause: Diagnostic, system: System, places: Places) -> Place:
    kind, _, name = cause.address.partition("/")
    match kind:
        case "host":
            return places.value(
                "hosts", name, "memory" if cause.code == planning_findings.MEMORY.code else "logical_processors"
            )
        case "component":
            return places.key("components", name)
        case "partition":
            return places.key(system.section_of(name), name)
        case _:
            return places.key("application")


def smaller_host_findings(seen: SeenHost, places: Places) -> Iterator[Diagnostic]:
    """Report where a host has less than the manifest says.

    Args:
        facts: as it was seen; None: it was not.

    Yields:
        A warning for its logical processors, and one for its memory.
    """
    host, facts = seen.host, seen.facts
    if facts.logical_processors < host.logical_processors:
        yield planning_findings.SMALLER.of_host(
            host.name,
            "{host} has {has:lp}, but the manifest has {manifest:lp}. The plan uses the value of the host.",
            f"Write `logical_processors: {facts.logical_processors}`.",
            place=places.value("hosts", host.name, "logical_processors"),
            has=facts.logical_processors,
            manifest=host.logical_processors,
        )
    if facts.memory < host.memory:
        yield planning_findings.SMALLER.of_host(
            host.name,
            "{host} has {_has}, but the manifest has {_says}. The plan uses the value of the host.",
            "Write the value of the host, or less.",
            place=places.value("hosts", host.name, "memory"),
            has_memory_bytes=facts.memory,
            manifest_memory_bytes=host.memory,
            _has=show_bytes(facts.memory, host.memory),
            _says=show_bytes(host.memory, facts.memory),
        )


def _remarks(answer: Layout, problem: Problem, places: Places) -> Iterator[Diagnostic]:
    """Report what a reader should know of where reservations come from."""
    groups = {group.name: group for group in problem.groups}
    measured: dict[str, list[tuple[tuple[str, ...], LookedUp]]] = {}
    for partition in answer.partitions:
        host = problem.system.hosts[partition.host]
        group = groups[partition.name]
        if group.request.cpu.reserve not in (None, Measured.MEASURED):
            continue
        found = problem.reservations.look_up(group.members, host)
        if isinstance(found, LookedUp):
            yield from remarks_as_findings(found.remarks, places)
            yield from little_memory(partition.components, partition.settings.memory, found, places)
            measured.setdefault(host.name, []).append((partition.components, found))
    for name, found_there in sorted(measured.items()):
        yield from other_governor(problem.seen[name], found_there, places)


def remarks_as_findings(remarks: Iterable[Diagnostic], places: Places) -> Iterator[Diagnostic]:
    """Report what a reader should know of measured reservations.

    Args:
        remarks: as a `ReservationSource` makes them.

    Yields:
        A finding for each, at the reserve of its component.
    """
    for remark in remarks:
        place = places.value("components", remark.address.removeprefix("component/"), "cpu", "reserve")
        yield replace(remark, place=place)


def _deadlines(answer: Layout, problem: Problem, places: Places) -> Iterator[Diagnostic]:
    """Report the deadlines of Linux hosts that the kernel would refuse, before anything is changed."""
    groups = {group.name: group for group in problem.groups}
    for host in by_name(problem.system.hosts):
        facts = problem.seen[host.name].facts
        admitted = USUAL_DEADLINE_PERCENT if facts.deadline_percent is None else facts.deadline_percent
        deadlines = [
            (partition, groups[partition.name])
            for partition in answer.on(host.name)
            if partition.settings.reserve and mechanism_of(groups[partition.name], host)[0] is Mechanism.DEADLINE
        ]
        for name, message, advice in deadline_problems(deadlines, host, facts.logical_processors, admitted):
            place = places.key(problem.system.section_of(name), name)
            values: dict[str, Any] = {"partition": name, "host": host.name, "admitted_percent": admitted}
            yield planning_findings.DEADLINES.at(
                place, "{_message}", advice, address=f"partition/{name}", _message=message, **values
            )


def _placement(answer: Layout, places: Places) -> Iterator[Diagnostic]:
    """Report how much better another layout could be, where that is not proved."""
    placement = answer.placement
    if placement is None or placement.proven:
        return
    gap = show_processors(Fraction(placement.reserved - placement.reserved_bound, 100))
    yield planning_findings.NOT_PROVEN.at(
        places.key("application"),
        (
            "The layout reserves {_reserved}, at most {_gap} more than needed. It moves {moves:partition}; at least "
            "{moves_bound} must move."
        ),
        "You can apply this layout.",
        reserved_lp=placement.reserved / 100,
        reserved_bound_lp=placement.reserved_bound / 100,
        moves=placement.moves,
        moves_bound=placement.moves_bound,
        _reserved=show_lp_percent(placement.reserved),
        _gap=gap,
        _counted=counted(placement.moves, "partition"),
    )


def _moves(answer: Layout, problem: Problem, places: Places) -> Iterator[Diagnostic]:
    """Report each partition that would reserve less on another host and stays because it is where it is."""
    for partition in answer.partitions:
        if problem.current_hosts.get(partition.name) != partition.host:
            continue
        best, host = min((claim.percent, host) for host, claim in problem.claims[partition.name].items())
        if best < partition.settings.processors * partition.settings.reserve:
            yield NOT_PROVEN.at(
                places.key("partitions", partition.name),
                "{partition} stays on {host}; on {other_host} it would reserve {_best} instead of {_reserved:lp}.",
                "If rarms may remove the partition and create it again, use `--max-disruption removal`.",
                address=f"partition/{partition.name}",
                partition=partition.name,
                host=partition.host,
                other_host=host,
                other_reserve_lp=best / 100,
                reserve_lp=partition.settings.processors * partition.settings.reserve / 100,
                _best=show_lp_percent(best),
                _reserved=partition.reserved,
            )
