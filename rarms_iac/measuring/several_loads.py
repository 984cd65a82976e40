"""Components with several loads, one after the other: each further load confirms the answer so far, or raises it."""

from collections import defaultdict
from collections.abc import Sequence
from dataclasses import replace
from itertools import groupby

from rarms_iac.measuring.evidence import leaves_idle
from rarms_iac.measuring.measure_request import ExperimentResult
from rarms_iac.measuring.run_experiment import run_experiment
from rarms_iac.measuring.session import MeasuringSession
from rarms_iac.measuring.strategies import Method, Search
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
    session: MeasuringSession, experiments: Sequence[Experiment], method: Method
) -> tuple[ExperimentResult, ...]:
    """Find the least reservation that stands up to every load.

    Args:
        experiments: The same components on the same host, one a load.

    Returns:
        A result for each load that was measured.
    """
    results: tuple[ExperimentResult, ...] = ()
    while (asked := next_experiment(experiments, results, method)) is not None:
        results = with_result(experiments, results, run_experiment(session, *asked))
    return results


def next_experiment(
    experiments: Sequence[Experiment], results: Sequence[ExperimentResult], method: Method
) -> tuple[Experiment, Method] | None:
    """Choose the next load, and its method.

    The first load has a search. Each further one is asked whether the answer so far is enough with it, and searched
    above only where it is not; so the last answer is the greatest. A sweep is run with each.

    Args:
        experiments: The same components on the same host, one a load.

    Returns:
        None: all are measured, or there is no answer that another load could confirm.
    """
    if len(results) == len(experiments) or (
        results and isinstance(results[-1].conclusion, NotAchievable | NotResolved | SettingFailed | Stopped)
    ):
        return None
    floor = (results[-1].reserve if results else None) or 0
    experiment = _after(results, experiments[len(results)])
    return experiment, replace(method, floor=floor) if isinstance(method, Search) else method


def with_result(
    experiments: Sequence[Experiment], results: tuple[ExperimentResult, ...], result: ExperimentResult
) -> tuple[ExperimentResult, ...]:
    """Add the result of the next load.

    Returns:
        None at all if the components used more processors with this load: then all are measured with so many.
    """
    if results and result.processors != results[-1].processors:
        return ()
    so_far = results[-1].reserve if results else None
    return (*results, replace(result, so_far=so_far, of_loads=len(experiments)))


def _after(results: Sequence[ExperimentResult], experiment: Experiment) -> Experiment:
    """With the time that settings took with the loads before, which share their budget with it."""
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
    """Find the result that the answer rests on.

    Args:
        results: Of the same components, in the order in which loads were measured; at least one.

    Returns:
        The first with the answer of the last; where the last has none, the last. Of sweeps that by which a plan
            reserves most.
    """
    last = results[-1]
    if isinstance(last.conclusion, Swept):
        return results[hardest([each.planned for each in results])]
    return last if last.reserve is None else next(each for each in results if each.reserve == last.reserve)
