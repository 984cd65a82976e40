"""Why there is no layout, as findings: who cannot share which hosts, by how much, and what would fit."""

from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import replace
from fractions import Fraction

from rarms_iac.model.diagnostics import Diagnostic, Finding, Place, Places
from rarms_iac.model.layout import Cause, Infeasible, Relaxation
from rarms_iac.model.quantities import show_bytes, show_percent, show_processors
from rarms_iac.model.wording import in_a_row, number
from rarms_iac.planner import findings
from rarms_iac.planner.infeasibility.conflict import Conflict, conflicts
from rarms_iac.planner.infeasibility.edits import TOGETHER, Trial
from rarms_iac.planner.infeasibility.ways_out import ways_out
from rarms_iac.planner.packing.values import Bin, cost, free_in, least_cost, least_memory
from rarms_iac.planner.problem import Problem

LISTED_UP_TO = 12
"""Names in a sentence; more are counted."""


def explained(answer: Infeasible, problem: Problem, trial: Trial) -> Infeasible:
    """Add to an answer without causes who conflicts, why, and what would fit.

    Args:
        answer: What `solve` said; with causes of its own it is complete.
        problem: What was solved.
        trial: Plans changed manifests.
    """
    if answer.causes:
        return answer
    found = conflicts(problem.items, problem.bins, proven=answer.proven)
    names = sorted({item.name for conflict in found for item in conflict.items})
    return replace(
        answer,
        proven=answer.proven or all(conflict.proven for conflict in found),
        conflict=tuple(names),
        causes=tuple(_cause(conflict, problem) for conflict in found),
        relaxations=ways_out(problem, names, trial),
    )


def _cause(conflict: Conflict, problem: Problem) -> Cause:
    what = f"host/{conflict.bins[0].name}" if conflict.bins else "application"
    if conflict.lacking == "processors":
        return Cause(what=what, says=_processors_exceed(conflict), code=findings.RESERVATIONS.code)
    if conflict.lacking == "memory":
        return Cause(what=what, says=_memory_exceeds(conflict, problem), code=findings.MEMORY.code)
    names = _listed([item.name for item in conflict.items])
    if len(conflict.bins) == 1:
        host = conflict.bins[0]
        says = (
            f"{names} cannot share {host.name}: each virtual processor needs its whole reserve on one of the "
            f"{_logical_processors(host)}, and there is no way to place them."
        )
        return Cause(what=what, says=says, code=findings.PACKING.code)
    hosts = _listed([host.name for host in conflict.bins])
    says = f"{names} cannot share {hosts}: together these have enough, but each partition needs room on one of them."
    return Cause(what=what, says=says, code=findings.PLACEMENT.code)


def _processors_exceed(conflict: Conflict) -> str:
    """As in: FDP 70 %, SRP 30 % and PPP 20 % need 120 % of the two logical processors."""
    ordered = sorted(conflict.items, key=lambda item: (-least_cost(item), item.name))
    total = sum(map(least_cost, ordered))
    if len(conflict.bins) > 1:
        free = sum(max(0, free_in(host).percent) for host in conflict.bins)
        return _exceed([(item.name, least_cost(item)) for item in ordered], free, conflict.bins, _show_processors)
    host = conflict.bins[0]
    whole = host.capacity.logical_processors

    def share(percent: int | Fraction) -> str:
        return show_percent(Fraction(percent) / whole)

    kept, taken = 100 * (whole - host.capacity.processors), sum(map(cost, host.taken))
    less: list[tuple[int | Fraction, str]] = [
        (kept, "kept for the host"),
        (taken, "taken by machines that are not ours"),
    ]
    words = [f"{share(amount)} {what}" for amount, what in less if amount]
    missing = f", of which {in_a_row(words)} are not to be had" if words else ""
    needs = [f"{item.name} {share(least_cost(item))}" for item in ordered]
    return f"{_listed(needs)} {_need(needs)} {share(total)} of the {_logical_processors(host)}{missing}."


def _memory_exceeds(conflict: Conflict, problem: Problem) -> str:
    """As in: FDP 3 GiB and SRP 2 GiB need 5 GiB; onboard has 4 GiB to promise.

    Where other partitions need memory of the same hosts, all are summed up as well, since the ways out count them.
    """
    ordered = sorted(conflict.items, key=lambda item: (-least_memory(item), item.name))
    free = sum(max(0, free_in(host).memory) for host in conflict.bins)
    message = _exceed([(item.name, least_memory(item)) for item in ordered], free, conflict.bins, show_bytes)
    if len(ordered) == len(problem.items) or len(conflict.bins) < len(problem.bins):
        return message
    total = show_bytes(sum(map(least_memory, problem.items)))
    return f"{message} All {number(len(problem.items))} partitions together need {total}."


def _exceed(needs: Sequence[tuple[str, int]], free: int, hosts: Sequence[Bin], show: Callable[[int], str]) -> str:
    parts = [f"{name} {show(amount)}" for name, amount in needs]
    names, have = _listed([host.name for host in hosts]), "has" if len(hosts) == 1 else "have"
    total = show(sum(amount for _, amount in needs))
    return f"{_listed(parts)} {_need(parts)} {total}; {names} {have} {show(free)} to promise."


def _show_processors(percent: int) -> str:
    return show_processors(Fraction(percent, 100))


def _logical_processors(host: Bin) -> str:
    many = host.capacity.logical_processors
    return f"{number(many)} logical processor{'' if many == 1 else 's'}"


def _need(parts: Sequence[str]) -> str:
    return "needs" if len(parts) == 1 else "need"


def _listed(words: Sequence[str]) -> str:
    if len(words) > LISTED_UP_TO:
        return f"{', '.join(words[:LISTED_UP_TO])} and {len(words) - LISTED_UP_TO} others"
    return in_a_row(words)


def diagnostics(answer: Infeasible, problem: Problem, places: Places) -> Iterator[Diagnostic]:
    """Tell the causes as findings; the ways out stand in each that they are for."""
    for cause in answer.causes:
        finding: Finding = findings.KINDS[cause.code]
        unsure = "" if answer.proven else " It is not proven that there is none: the search ended at its limit."
        detail = f"{cause.says}{unsure}"
        yield finding.at(_place(cause, problem, places), detail, _advice(cause, answer.relaxations), address=cause.what)


def _advice(cause: Cause, ways: Sequence[Relaxation]) -> str:
    usual: Mapping[str, str] = {
        findings.UNMEASURED.code: "Fix it with `cpu: { reserve: ... }`, or measure it first.",
        findings.PARALLELISM.code: "Give the partition or the component more `processors`, or lower the reserve.",
        findings.TOO_WIDE.code: "Lower `processors`, or name a larger host.",
        findings.COMPANY.code: "Change `partitions`, or take the rule out.",
    }
    if cause.advice or cause.code in usual:
        return cause.advice or usual[cause.code]
    if not ways:
        return "No change that was tried makes it fit: remove a component, or add a host."
    sure = [way.says for way in ways if not way.may]
    lines = [_only_way(sure[0])] if len(sure) == 1 else []
    if len(sure) > 1:
        lines = ["\n- ".join(["Each of these alone would fit:", *sure])]
    return "\n".join([*lines, *(f"{way.says[0].upper()}{way.says[1:]}." for way in ways if way.may)])


def _only_way(way: str) -> str:
    """As in: This would fit: 1 GiB more memory on onboard. Several changes stand in a list."""
    several = way.removeprefix(f"{TOGETHER}\n")
    return f"This would fit: {way}." if several == way else f"All of these together would fit:\n{several}."


def _place(cause: Cause, problem: Problem, places: Places) -> Place:
    kind, _, name = cause.what.partition("/")
    match kind:
        case "host":
            return places.value("hosts", name, "memory" if cause.code == findings.MEMORY.code else "logical_processors")
        case "component":
            return places.key("components", name)
        case "partition":
            return places.key(problem.system.section_of(name), name)
        case _:
            return places.key("application")
