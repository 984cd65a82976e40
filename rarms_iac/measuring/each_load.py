"""Measures the same components with one load after the other: the least reservation that is enough with each.

In: the experiments of a partition, one a load, and a method. Out: a result a load, of which `decisive` names the one
that decides. Begin at `measure_with_each_load`; `next_experiment` and `with_result` decide by values alone.
"""

from collections import defaultdict
from collections.abc import Callable, Sequence
from dataclasses import replace
from itertools import groupby

from rarms_iac.measuring.evidence import leaves_idle
from rarms_iac.measuring.measure_request import ExperimentResult
from rarms_iac.measuring.run_experiment import run_experiment
from rarms_iac.measuring.session import MeasuringSession
from rarms_iac.measuring.strategies import FirstPass, Method, Search, is_of_paper
from rarms_iac.model.capacity import shared_processors
from rarms_iac.model.experiment import Experiment
from rarms_iac.model.loads import is_steady
from rarms_iac.model.outcomes import NotAchievable, NotResolved, SettingFailed, Stopped, Swept
from rarms_iac.model.quantities import ReservePercent
from rarms_iac.model.setting import Setting
from rarms_iac.planner.verdicts import hardest


def by_partition(experiments: Sequence[Experiment]) -> tuple[tuple[Experiment, ...], ...]:
    """Put the experiments of the same components on the same host together, one a load, in the order given.

    Args:
        experiments: Those of the same components and host follow one another.

    Returns:
        Groups that differ in nothing but the load.
    """
    groups = groupby(experiments, key=lambda each: (each.host.name, each.setup.members))
    return tuple(tuple(group) for _, group in groups)


def measure_with_each_load(
    session: MeasuringSession,
    experiments: Sequence[Experiment],
    method: Method,
    begin: ReservePercent = 0,
    ended: Callable[[ExperimentResult], None] = lambda _result: None,
) -> tuple[ExperimentResult, ...]:
    """Find the least reservation that meets the thresholds under every load.

    Args:
        experiments: The same components on the same host, one a load.
        begin: The answer of the first pass, at which the search with the first load begins; 0: there is none.
        ended: Receives the result with each load, once.

    Returns:
        A result for each load that was measured.
    """
    results: tuple[ExperimentResult, ...] = ()
    if isinstance(method, Search):
        method = replace(method, begin=begin)
    while (asked := next_experiment(experiments, results, method)) is not None:
        result = run_experiment(session, *asked)
        if len(results) < len(experiments):
            ended(result)
        results = with_result(experiments, results, result)
    return results


def next_experiment(
    experiments: Sequence[Experiment], results: Sequence[ExperimentResult], method: Method
) -> tuple[Experiment, Method] | None:
    """Choose the next load, and its method.

    The first load has a search. Each further one is asked whether the answer so far is enough with it, and searched
    above only where it is not; so the last answer is the greatest. A sweep is run with each. In the end the settings at
    the answer of a search go on until nothing has a condition that more samples would lift.

    Args:
        experiments: The same components on the same host, one a load.

    Returns:
        None: all are measured, or there is no answer that another load could confirm.
    """
    if results and isinstance(results[-1].conclusion, NotAchievable | NotResolved | SettingFailed):
        return None
    if any(each.stopped for each in results):
        return None
    floor = (results[-1].reserve if results else None) or 0
    if len(results) < len(experiments):
        experiment = after_loads(results, experiments[len(results)])
        return experiment, replace(method, floor=floor) if isinstance(method, Search | FirstPass) else method
    if not isinstance(method, Search) or is_of_paper(method):
        return None
    for number, result in enumerate(results):
        if result.reserve == floor and result.conditions and not result.is_confirmed:
            others = (*results[:number], *results[number + 1 :])
            return after_loads(others, experiments[number]), replace(method, floor=floor, confirms=True)
    return None


def with_result(
    experiments: Sequence[Experiment], results: tuple[ExperimentResult, ...], result: ExperimentResult
) -> tuple[ExperimentResult, ...]:
    """Add the result of the next load, or of one that was measured further to confirm the answer.

    Returns:
        None at all if the components used more processors with this load: then all are measured with so many. A result
        that does not confirm the answer is the last one; one that was stopped leaves the answer as it is.
    """
    if results and result.processors != results[-1].processors:
        return ()
    if len(results) < len(experiments):
        so_far = results[-1].reserve if results else None
        return (*results, replace(result, so_far=so_far, of_loads=len(experiments)))
    number = next(at for at, each in enumerate(results) if each.interference == result.interference)
    before = results[number]
    if result.stopped:
        return (*results[:number], replace(before, is_interrupted=True), *results[number + 1 :])
    further = replace(result, so_far=before.so_far, of_loads=before.of_loads, is_confirmed=True)
    if result.reserve != before.reserve:
        return (*results[:number], replace(further, is_confirmed=False))
    return (*results[:number], further, *results[number + 1 :])


def after_loads(results: Sequence[ExperimentResult], experiment: Experiment) -> Experiment:
    """Charge the budget with the time of settings under the earlier loads, which share it."""
    spent_ms: defaultdict[ReservePercent, float] = defaultdict(float)
    for setting in (setting for result in results for setting in result.settings):
        spent_ms[setting.reserve] += setting.host_ms
    return replace(experiment, budget=replace(experiment.budget, spent_ms=spent_ms))


def leave_idle(results: Sequence[ExperimentResult]) -> bool:
    """Tell whether every load of the results was seen to leave processors idle that it could take.

    Args:
        results: Of the same components, one a load.

    Returns:
        False where one of them sleeps by design: such loads are not judged by idle time.
    """
    return all(is_steady(each.experiment.load) and bool(idle_settings(each)) for each in results)


def idle_settings(result: ExperimentResult) -> list[Setting]:
    """Return the settings at the answer of a result in which its load left processors idle."""
    host = result.experiment.host
    shared = shared_processors(host, host.logical_processors)
    at_answer = [setting for setting in result.settings if setting.reserve == result.reserve]
    return [setting for setting in at_answer if leaves_idle(setting.evidence, shared)]


def decisive(results: Sequence[ExperimentResult]) -> ExperimentResult:
    """Find the result that decides the answer.

    Args:
        results: Of the same components, in the order in which loads were measured; at least one.

    Returns:
        The first with the greatest answer, or the one without an answer. Of sweeps that by which a plan reserves most.
            One that was stopped before it had an answer decides only where there is no other.
    """
    known = [each for each in results if not isinstance(each.conclusion, Stopped) or each.planned is not None]
    known = known or list(results)
    amounts = [each.planned if isinstance(each.conclusion, Swept | Stopped) else each.reserve for each in known]
    return known[hardest(amounts)]
