"""Why there is no layout: a smallest set that conflicts, and what was tried and helps (DESIGN section 3)."""

from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from fractions import Fraction

from rarms_iac.model.diagnostics import Diagnostic, Place, Places
from rarms_iac.model.layout import Cause, Infeasible, Relaxation
from rarms_iac.model.plan import Claim
from rarms_iac.model.quantities import plain, show_bytes, show_percent, show_processors
from rarms_iac.model.where import partition_place
from rarms_iac.planner import findings
from rarms_iac.planner.does_not_fit.relaxations import relaxations
from rarms_iac.planner.does_not_fit.smaller import alone, by_hosts, certified_impossible, hosts_of
from rarms_iac.planner.does_not_fit.variants import Trial
from rarms_iac.planner.first_fit import Bin, Item, cost, free_in
from rarms_iac.planner.problem import Problem
from rarms_iac.planner.search import place

FILTERED_UP_TO = 12
"""Partitions of which a smallest conflicting set is searched, one removal after the other."""

LISTED_UP_TO = 12
"""Names in a sentence; more are counted."""

_SEARCHED = {
    findings.RESERVATIONS.code: False,
    findings.MEMORY.code: False,
    findings.PACKING.code: True,
    findings.PLACEMENT.code: True,
}
"""Causes that a certificate can be of; and whether they take a search, where a sum shows the others."""

_WORDS = ("no", "one", "two", "three", "four", "five", "six", "seven", "eight", "nine", "ten", "eleven", "twelve")


def explained(answer: Infeasible, problem: Problem, trial: Trial) -> Infeasible:
    """The same answer with its conflict, its causes and ways out; each way out was planned and fits."""
    if answer.causes:
        return answer
    found = _conflict(problem.items, problem.bins)
    certificate = _certificate(found.names, problem) if answer.proven or found.proven else ""
    return replace(
        answer,
        proven=answer.proven or found.proven,
        conflict=found.names,
        causes=found.causes,
        relaxations=relaxations(problem, found.names, trial),
        certificate=certificate,
    )


@dataclass(frozen=True, slots=True, kw_only=True)
class _Conflict:
    """Partitions that do not fit together, why, and whether that is proved by looking at them."""

    names: tuple[str, ...]
    causes: tuple[Cause, ...]
    proven: bool


def _certificate(names: Sequence[str], problem: Problem) -> str:
    """Of the partitions that conflict; of all of them where those have none."""
    few = [one for one in problem.items if one.name in names]
    return certified_impossible(few, problem.bins) or certified_impossible(problem.items, problem.bins)


def _conflict(items: Sequence[Item], bins: Sequence[Bin]) -> _Conflict:
    for some in (tuple(items), *by_hosts(items)):
        too_much = _too_much(some, hosts_of(some, bins) if len(some) < len(items) else bins)
        if too_much is not None:
            return too_much
    few = alone(items, bins)
    names = _filtered(few or items, bins)
    theirs = hosts_of([one for one in items if one.name in names], bins)
    if len(theirs) == 1:
        says = (
            f"The virtual processors of {_listed(names)} find no room on the {_processors(theirs[0])}, though their "
            f"sum would: each needs its whole reserve on one of them."
        )
        cause = Cause(what=_where(theirs), says=says, code=findings.PACKING.code)
    else:
        says = f"{_listed(names)} find no room together on {_listed([one.name for one in theirs])}, host by host."
        cause = Cause(what=_where(theirs), says=says, code=findings.PLACEMENT.code)
    return _Conflict(names=names, causes=(cause,), proven=few is not None)


def _too_much(items: Sequence[Item], bins: Sequence[Bin]) -> _Conflict | None:
    """What exceeds the hosts by its sum alone."""
    found = []
    for measure, code, sentence in (
        (cost, findings.RESERVATIONS.code, _says_processors),
        (_memory, findings.MEMORY.code, _says_memory),
    ):
        free = sum(max(0, measure_of) for measure_of in (_room(one, code) for one in bins))
        names = _largest_that_exceed(items, measure, free)
        if names:
            chosen = [one for one in items if one.name in names]
            found.append((names, Cause(what=_where(bins), says=sentence(chosen, bins), code=code)))
    if not found:
        return None
    together = sorted({name for names, _ in found for name in names})
    return _Conflict(names=tuple(together), causes=tuple(cause for _, cause in found), proven=True)


def _memory(claim: Claim) -> int:
    return claim.memory


def _room(one: Bin, code: str) -> int:
    free = free_in(one)
    return free.percent if code == findings.RESERVATIONS.code else free.memory


def _largest_that_exceed(items: Sequence[Item], measure: Callable[[Claim], int], free: int) -> tuple[str, ...]:
    """The fewest partitions whose least claims exceed what there is: the largest, until it is too much."""
    least = sorted(
        ((min(measure(c) for c in one.claims.values()), one.name) for one in items), key=lambda x: (-x[0], x[1])
    )
    total, names = 0, []
    for amount, name in least:
        total += amount
        names.append(name)
        if total > free:
            return tuple(names)
    return ()


def _filtered(items: Sequence[Item], bins: Sequence[Bin]) -> tuple[str, ...]:
    """A set from which none can be left out: small ones are left out first. All of them where there are too many."""
    left = sorted(items, key=lambda one: (min(cost(c) for c in one.claims.values()), one.name))
    if len(left) > FILTERED_UP_TO:
        return tuple(sorted(one.name for one in left))
    for item in tuple(left):
        without = [one for one in left if one is not item]
        answer = place(without, bins)
        if answer.hosts is None and answer.proven:
            left = without
    return tuple(sorted(one.name for one in left))


def _says_processors(chosen: Sequence[Item], bins: Sequence[Bin]) -> str:
    """Say it as in: FDP 70 %, SRP 30 % and PPP 20 % need 120 % of the two logical processors."""
    ordered = sorted(chosen, key=lambda one: (-min(cost(c) for c in one.claims.values()), one.name))
    taken = sum(cost(claim) for one in bins for claim in one.taken)
    if len(bins) == 1:
        host = bins[0]
        whole = host.capacity.logical_processors

        def share(percent: int | Fraction) -> str:
            return show_percent(Fraction(percent) / whole)

        kept = 100 * (whole - host.capacity.processors)
        parts = [f"{one.name} {share(cost(one.claims[host.name]))}" for one in ordered]
        total = share(sum(cost(one.claims[host.name]) for one in ordered))
        return (
            f"{_listed(parts)} {_verb(parts)} {total} of the {_processors(host)}"
            f"{_less([(kept, 'kept for the host'), (taken, 'taken by machines that are not ours')], share)}."
        )
    parts = [
        f"{one.name} {show_processors(Fraction(min(cost(c) for c in one.claims.values()), 100))}" for one in ordered
    ]
    total = show_processors(sum(Fraction(min(cost(c) for c in one.claims.values()), 100) for one in ordered))
    free = show_processors(Fraction(sum(max(0, free_in(one).percent) for one in bins), 100))
    return f"{_listed(parts)} {_verb(parts)} {total}; {_listed([one.name for one in bins])} have {free} to promise."


def _says_memory(chosen: Sequence[Item], bins: Sequence[Bin]) -> str:
    ordered = sorted(chosen, key=lambda one: (-min(c.memory for c in one.claims.values()), one.name))
    parts = [f"{one.name} {show_bytes(min(c.memory for c in one.claims.values()))}" for one in ordered]
    total = show_bytes(sum(min(c.memory for c in one.claims.values()) for one in ordered))
    free = show_bytes(sum(max(0, free_in(one).memory) for one in bins))
    have = "has" if len(bins) == 1 else "have"
    return f"{_listed(parts)} {_verb(parts)} {total}; {_listed([one.name for one in bins])} {have} {free} to promise."


def _less(amounts: Sequence[tuple[int | Fraction, str]], share: Callable[[int | Fraction], str]) -> str:
    words = [f"{share(amount)} {what}" for amount, what in amounts if amount]
    return f", of which {_listed(words)} are not to be had" if words else ""


def _verb(parts: Sequence[str]) -> str:
    return "needs" if len(parts) == 1 else "need"


def _processors(host: Bin) -> str:
    number = host.capacity.logical_processors
    word = _WORDS[number] if number < len(_WORDS) else plain(number)
    return f"{word} logical processor{'' if number == 1 else 's'}"


def _listed(words: Sequence[str]) -> str:
    if len(words) > LISTED_UP_TO:
        return f"{', '.join(words[:LISTED_UP_TO])} and {len(words) - LISTED_UP_TO} others"
    return words[0] if len(words) == 1 else f"{', '.join(words[:-1])} and {words[-1]}"


def _where(bins: Sequence[Bin]) -> str:
    return f"host/{bins[0].name}" if bins else "application"


def told(answer: Infeasible, problem: Problem, places: Places) -> Iterator[Diagnostic]:
    """The causes as findings; the ways out stand in each that they are for."""
    ways = answer.relaxations
    for cause in answer.causes:
        finding = findings.KINDS[cause.code]
        advice = _advice(cause, ways)
        says = cause.says
        yield finding.at(_place(cause, problem, places), f"{says}{_sure(answer, cause)}", advice, address=cause.what)


def _sure(answer: Infeasible, cause: Cause) -> str:
    """How sure it is that there is no placement."""
    if cause.code not in _SEARCHED:
        return ""
    if not answer.proven:
        return " It is not proven that there is none: the search gave up before it had tried everything."
    if answer.certificate:
        return " This is certified."
    return " This is proved by search, not certified." if _SEARCHED[cause.code] else ""


def _advice(cause: Cause, ways: Sequence[Relaxation]) -> str:
    usual: Mapping[str, str] = {
        findings.UNMEASURED.code: "Fix it with `cpu: { reserve: ... }`, or measure it first.",
        findings.PARALLELISM.code: "Give the partition or the component more `processors`, or lower the reserve.",
        findings.TOO_WIDE.code: "Lower `processors`, or name a larger host.",
        findings.COMPANY.code: "Change `partitions`, or take the rule out.",
    }
    if cause.advice:
        return cause.advice
    if cause.code in usual:
        return usual[cause.code]
    if not ways:
        return "No change that was tried makes it fit: remove a component, or add a host."
    sure = [one.says for one in ways if not one.may]
    told = [f"This would fit: {sure[0]}."] if len(sure) == 1 else []
    if len(sure) > 1:
        told = ["\n- ".join(["Each of these alone would fit:", *sure])]
    told += [f"{one.says[0].upper()}{one.says[1:]}." for one in ways if one.may]
    return "\n".join(told)


def _place(cause: Cause, problem: Problem, places: Places) -> Place:
    kind, _, name = cause.what.partition("/")
    match kind:
        case "host":
            last = "memory" if cause.code == findings.MEMORY.code else "logical_processors"
            return places.value("hosts", name, last)
        case "component":
            return places.key("components", name)
        case "partition":
            return partition_place(problem.system, places, name)
        case _:
            return places.key("application")
