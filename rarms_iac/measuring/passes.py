"""The passes of `rarms measure`: first a provisional answer for every partition, then the bounds.

The first pass has a few short settings with the load that decides most often, then one with each other load, and more
where that one asks for more. Later passes add the precision of the policy, the least known partition first. Without a
first pass, the data logs order the loads. Begin at `first_pass`.
"""

from collections.abc import Sequence
from dataclasses import replace
from math import inf

from rarms_iac.measuring.each_load import decisive, next_experiment, with_result
from rarms_iac.measuring.measure_request import ExperimentResult
from rarms_iac.measuring.run_experiment import run_experiment
from rarms_iac.measuring.session import MeasuringSession
from rarms_iac.measuring.strategies import FirstPass
from rarms_iac.measuring.units import Units, describe_processors, is_simulated, longest_first_ms, longest_later_ms
from rarms_iac.model.experiment import Experiment
from rarms_iac.model.loads import load_of_first_pass
from rarms_iac.model.outcomes import Stopped
from rarms_iac.planner.reservations import MeasuredReservations
from rarms_iac.planner.verdicts import MeasuredTogether

Group = tuple[Experiment, ...]
"""The same components on the same host, one experiment a load."""


def first_pass(
    session: MeasuringSession, groups: Sequence[Group], *, more_follows: bool
) -> tuple[tuple[ExperimentResult, ...], ...]:
    """Find a provisional reservation for each partition: first for all with one load, then with the others.

    Returns:
        The results of each group, one a load, in their order; of fewer groups where an end was asked for.
    """
    found: list[tuple[ExperimentResult, ...]] = []
    ordered = tuple(map(begin_with_hardest, groups))
    known = not any(map(is_simulated, groups))  # how long it takes by the user's clock
    units = Units(
        reporter=session.control.reporter.settings,
        of=sum(map(len, groups)),
        more_follows=more_follows,
        longest_ms=max(map(longest_first_ms, groups)) if known else None,
        later_ms=sum(len(group) * longest_later_ms(group) for group in groups) if more_follows else 0.0,
    )
    for group in ordered:
        found.append(_look_with(session, group, (), 1, units))
        if any(each.stopped for each in found[-1]):
            return tuple(found)
    if words := describe_processors([each for results in found for each in results]):
        session.control.reporter.message(words)
    for number, group in enumerate(ordered):
        found[number] = _look_with(session, group, found[number], len(group), units)
        if any(each.stopped for each in found[number]):
            break
    return tuple(found)


def _look_with(
    session: MeasuringSession, group: Group, results: tuple[ExperimentResult, ...], loads: int, units: Units
) -> tuple[ExperimentResult, ...]:
    """Go on with a group until it has results with so many loads, or has no answer."""
    while len(results) < loads and (asked := next_experiment(group, results, FirstPass())) is not None:
        result = run_experiment(session, *asked)
        units.add(result)
        results = with_result(group, results, result)
    return results


def later_passes(groups: Sequence[Group], looks: Sequence[Sequence[ExperimentResult]]) -> tuple[Group, ...]:
    """Order what follows the first pass: the least known partition first, and of each the load that decided there.

    Args:
        looks: as of `first_pass`.
    """
    answers = [_hardest(of_loads) for of_loads in looks]
    known = sorted(zip(answers, groups, strict=True), key=lambda each: -_doubt(each[0]))
    return tuple(begin_with_hardest(group, look.interference) for look, group in known)


def _hardest(of_loads: Sequence[ExperimentResult]) -> ExperimentResult:
    """Return the result that decides; of several with one answer that with the highest lower setting that failed.

    So the same command begins with the load with which it searched before, not with one that only confirmed.
    """
    answer = decisive(of_loads)
    if answer.reserve is None:
        return answer
    return max((each for each in of_loads if each.reserve == answer.reserve), key=lambda each: each.failed or 0)


def begin_with_decisive(groups: Sequence[Group], reservations: MeasuredReservations) -> tuple[Group, ...]:
    """Put the load of each group in front that decides by the data logs; without one, that which decides most often."""
    return tuple(begin_with_hardest(group, _decisive_load(group, reservations)) for group in groups)


def _decisive_load(group: Group, reservations: MeasuredReservations) -> str:
    log = reservations.log(group[0].members, group[0].host)
    known = {each.setup.interference for each in group}
    return log.interference if isinstance(log, MeasuredTogether) and log.interference in known else ""


def begin_with_hardest(group: Group, name: str = "") -> Group:
    """Return a group with one load in front; all loads share the budget in this order.

    Args:
        name: of the load; empty: the one that decides most often.
    """
    name = name or load_of_first_pass({each.setup.interference: each.load for each in group})
    ordered = sorted(group, key=lambda each: each.setup.interference != name)
    loads = tuple(each.load for each in ordered)
    return tuple(replace(each, loads=loads) for each in ordered)


def _doubt(look: ExperimentResult) -> float:
    """Return which part of an answer is not known yet: 0 where it is final, infinite without one."""
    if look.reserve is None:
        return inf
    return (look.reserve - (look.failed or 0)) / look.reserve if look.is_provisional else 0.0


def with_first_pass(
    results: Sequence[ExperimentResult], look: Sequence[ExperimentResult]
) -> tuple[ExperimentResult, ...]:
    """Return the results of a partition after an end was asked for: of each load the best answer so far.

    Args:
        results: of the later pass, the last one stopped; of one without an answer that of the first pass counts.
        look: of the first pass; empty: there was none.
    """
    seen = {each.interference: each for each in look}
    last = results[-1]
    if not isinstance(last.conclusion, Stopped) or last.planned is not None or last.interference not in seen:
        before = (*results,)
    else:
        before = (*results[:-1], replace(seen[last.interference], is_interrupted=True))
    measured = {each.interference for each in results}
    return (*before, *(each for each in look if each.interference not in measured))


def is_of(look: Sequence[ExperimentResult], group: Sequence[Experiment]) -> bool:
    """Tell whether results of the first pass are of this partition."""
    first = group[0]
    return any((each.host, each.components) == (first.host.name, first.setup.members) for each in look)


def in_order_of(results: Sequence[ExperimentResult], experiments: Sequence[Experiment]) -> tuple[ExperimentResult, ...]:
    """Return results partition by partition, in the order in which experiments were asked for."""
    asked = list(dict.fromkeys((each.host.name, each.setup.members) for each in experiments))
    return tuple(sorted(results, key=lambda each: asked.index((each.host, each.components))))
