"""How long measuring will take, at least and at most: from the settings that may be asked for and how each ends.

Begin at `expected_duration`. Times are of the host's own clock: a simulated host does not make its user wait for them.
"""

from collections.abc import Iterable, Sequence
from dataclasses import dataclass, replace
from math import ceil, inf

from rarms_iac.measuring.methods import Method, is_of_paper, reserves_of
from rarms_iac.measuring.search.bracketing import MOST
from rarms_iac.measuring.strategies import SettingCount, Sweep
from rarms_iac.model.experiment import Experiment
from rarms_iac.model.host import ProviderKind
from rarms_iac.model.indexes import index_named
from rarms_iac.model.loads import Interference
from rarms_iac.model.quantities import Unit
from rarms_iac.model.run import Elapsed, Periodic, Run, SampleCount
from rarms_iac.model.setting import Setting
from rarms_iac.model.system import AtLeast, AtMost, Component, run_of
from rarms_iac.statistics.error_probability import FIRST_LOOK, samples_needed
from rarms_iac.statistics.setting_time import MEMORY_FACTOR, least_setting_ms

_UNTIL_CLEAR = SettingCount(least=1, most=1, ends_early=True, goes_on=True)

STEPS_OF_PAPER = 10
"""Settings that CMCPUR asks for at most: 10, 20, ... 100 %."""


@dataclass(frozen=True, slots=True, kw_only=True)
class DurationBounds:
    """Between what numbers the settings and the time of an experiment will lie.

    Where settings go on until they are clear, `most_ms` has the whole budget of each; where they end at `run.until`, it
    is a bound where jobs answer as fast as their thresholds ask (those without a threshold of time: within their
    timeout). It never takes more settings than `most_settings`.
    """

    least_settings: int
    most_settings: int
    least_ms: float
    most_ms: float
    measured: int = 0  # settings of the data log whose time it rests on; 0: it rests on what the manifest allows
    by_timeout: bool = False  # `most_ms` has only some component's timeout to go by: far beyond what is usual


def settings_to_run(
    method: Method, recorded: Iterable[Setting], most: int, *, shows_processors: bool = False
) -> SettingCount:
    """Count the settings that are still to be run.

    Args:
        method: How they are chosen.
        recorded: The settings so far, which are not run again.
        most: The highest CR that the host can give, in per cent.
        shows_processors: Whether the first may only show how many processors are used, and be no point of the curve.
    """
    further = 1 if shows_processors else 0
    if isinstance(method, Sweep):
        count = len(set(reserves_of(method, most)) - {setting.reserve for setting in recorded})
        return SettingCount(least=count, most=count + further, ends_early=False)
    bound = min(STEPS_OF_PAPER, ceil(most / STEPS_OF_PAPER)) if is_of_paper(method) else min(MOST, most) + further
    return SettingCount(least=1, most=max(1, bound), ends_early=True, goes_on=not is_of_paper(method))


def with_part_of_budget(experiment: Experiment, window_ms: float) -> Experiment:
    """Return the experiment with its load's part of what a setting may take beside all loads that share it.

    A load may take what those before it left, but for the least that a setting takes beside those after it. A budget
    that is no longer than the least of all has parts in proportion to these.

    Args:
        experiment: What is measured; its budget is that of all its loads.
        window_ms: The longest of its host's scheduler.
    """
    budget, number = experiment.budget, experiment.loads.index(experiment.load)
    least = [least_ms(experiment, load, window_ms) for load in experiment.loads]
    share = min(1.0, budget.most_ms / sum(least))
    budget = replace(budget, most_ms=budget.most_ms - share * sum(least[number + 1 :]), least_ms=share * least[number])
    return replace(experiment, budget=budget)


def least_ms(experiment: Experiment, load: Interference, window_ms: float, earlier: Sequence[Setting] = ()) -> float:
    """Say how long a setting of a search takes at least.

    Args:
        experiment: Its components.
        load: Beside which they run.
        window_ms: The longest of its host's scheduler.
        earlier: Settings of its data log, which tell how fast jobs are.

    Returns:
        Milliseconds by the host's clock.
    """
    return least_setting_ms(
        max(_least_ms(run_of(member), member, earlier, _UNTIL_CLEAR) for member in experiment.members),
        load,
        window_ms,
        is_periodic=any(isinstance(run_of(member).arrival, Periodic) for member in experiment.members),
        begins_anew=experiment.host.provider is not ProviderKind.HYPERV,
    )


def expected_duration(
    experiment: Experiment, count: SettingCount, earlier: Sequence[Setting] = (), window_ms: float = 0.0
) -> DurationBounds:
    """Work out how long an experiment will take that is begun or goes on.

    Args:
        experiment: What is measured.
        count: How many settings are still to be run.
        earlier: All settings of its data log: how fast jobs were tells how fast they may be.
        window_ms: The longest of its host's scheduler.

    Returns:
        Bounds of what is still to be run: by the quickest and the slowest setting whose time the log has, with all
        tries of one that was disturbed. Without such a record every job takes at most as long as its thresholds
        allow; at least, jobs are as fast as the fastest recorded, and without a record take no time unless they
        have a period.
    """
    if spent := [_spent_again_ms(experiment, setting, count) for setting in earlier if setting.spent_ms is not None]:
        return DurationBounds(
            least_settings=count.least,
            most_settings=count.most,
            least_ms=count.least * min(spent),
            most_ms=count.most * max(spent),
            measured=len(spent),
        )
    # Members run together: a setting ends when each has what it needs.
    settles_ms = MEMORY_FACTOR * window_ms
    shortest = max(_least_ms(run_of(member), member, earlier, count) for member in experiment.members)
    shortest = settles_ms + max(shortest, settles_ms)
    ends = [_ends_ms(run_of(member).ends, run_of(member), _allowed_ms(member)) for member in experiment.members]
    longest = settles_ms + max(settles_ms, *ends)
    if count.goes_on:
        shortest = least_ms(experiment, experiment.load, window_ms, earlier)
        named = [member for member in experiment.members if run_of(member).until is not None]
        longest = max(
            experiment.budget.most_ms,
            *(settles_ms + _ends_ms(run_of(member).ends, run_of(member), _allowed_ms(member)) for member in named),
            shortest,
        )
    return DurationBounds(
        least_settings=count.least,
        most_settings=count.most,
        least_ms=count.least * shortest,
        most_ms=count.most * longest,
        by_timeout=not count.goes_on
        and any(_allowed_ms(member) >= run_of(member).timeout for member in experiment.members),
    )


def _spent_again_ms(experiment: Experiment, setting: Setting, count: SettingCount) -> float:
    """What an earlier setting would take now: in proportion to the samples, where it ends after a number of them."""
    if count.goes_on:
        return setting.host_ms
    taken = {series.component: len(series.samples) for series in setting.series}
    ratios = [
        ends.samples / taken[member.name]
        for member in experiment.members
        if isinstance(ends := run_of(member).ends, SampleCount) and taken.get(member.name)
    ]
    return setting.host_ms * max(ratios, default=1.0)


def least_samples(member: Component) -> int:
    """Say how many samples a setting takes at least that shows all thresholds of a component to be met.

    Args:
        member: with thresholds, or without.

    Returns:
        `run.until`, where that is a number and larger; what jitter needs is known only after a first setting.
    """
    until = run_of(member).until
    needed = max((samples_needed(index, threshold) for index, threshold in member.apt.items()), default=FIRST_LOOK)
    return max(needed, until.samples) if isinstance(until, SampleCount) else needed


def _least_ms(run: Run, member: Component, earlier: Sequence[Setting], count: SettingCount) -> float:
    """A setting of a search may end as soon as its samples tell, a setting of a sweep goes on to its end."""
    between = float(run.arrival.period) if isinstance(run.arrival, Periodic) else _fastest_ms(member.name, earlier)
    if count.goes_on:
        return least_samples(member) * between
    if isinstance(run.ends, Elapsed):
        return min(float(run.ends.time), FIRST_LOOK * between if count.ends_early else inf)
    return (min(FIRST_LOOK, run.ends.samples) if count.ends_early else run.ends.samples) * between


def _fastest_ms(name: str, earlier: Sequence[Setting]) -> float:
    """The time of a job, on the average of the setting where it was least; 0 where nothing is recorded."""
    paces = [
        series.elapsed_ms / len(series.samples)
        for setting in earlier
        for series in setting.series
        if series.component == name and series.samples
    ]
    return min(paces, default=0.0)


def _allowed_ms(member: Component) -> float:
    """The longest that a job may take by the thresholds; without one that tells, its timeout."""
    run = run_of(member)
    times = [float(run.deadline)] if run.deadline is not None else []
    for name, threshold in member.apt.items():
        match index_named(name).unit, threshold:
            case Unit.TIME, AtMost(value=value):
                times.append(float(value))
            case Unit.RATE, AtLeast(value=value) if value > 0:
                times.append(float(1000 / value))
            case _:
                pass
    return min(max(times, default=inf), float(run.timeout))


def _ends_ms(ends: SampleCount | Elapsed, run: Run, job_ms: float) -> float:
    """When a setting ends whose jobs take so long; the last one may begin when the time is up."""
    return float(ends.time) + job_ms if isinstance(ends, Elapsed) else ends.samples * _between_ms(run, job_ms)


def _between_ms(run: Run, job_ms: float) -> float:
    """From the start of one job to the next."""
    return max(job_ms, float(run.arrival.period)) if isinstance(run.arrival, Periodic) else job_ms
