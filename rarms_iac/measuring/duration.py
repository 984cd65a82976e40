"""How many settings measuring will take, and how long: from the settings that may be asked for and how each ends.

`forecast` writes every duration to come: of a pass, an experiment, a proof, and what is left of them. Times are of the
host's own clock: a simulated host does not make its user wait for them.
`WallTimes` has what settings took on this machine; it is kept in memory alone.
"""

import time
from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass, field, replace
from math import ceil, inf
from statistics import fmean

from rarms_iac.app.control import RemainingSettings
from rarms_iac.measuring.search.bracketing import MOST
from rarms_iac.measuring.strategies import Method, SettingCount, Sweep, is_of_paper, reserves_of
from rarms_iac.model.experiment import Experiment
from rarms_iac.model.host import ProviderKind
from rarms_iac.model.loads import Interference
from rarms_iac.model.run import Elapsed, Periodic, Run, SampleCount
from rarms_iac.model.setting import Setting
from rarms_iac.model.system import Component, run_of
from rarms_iac.statistics.distributions import FIRST_LOOK, samples_needed
from rarms_iac.statistics.steady_state import MEMORY_FACTOR, least_setting_ms
from rarms_iac.texts.messages import counted
from rarms_iac.texts.quantities import show_duration

_UNTIL_CLEAR = SettingCount(least=1, most=1, ends_early=True, goes_on=True)

STEPS_OF_PAPER = 10
"""Settings that CMCPUR asks for at most: 10, 20, ... 100 %."""


def settings_to_run(
    method: Method, recorded: Iterable[Setting], most: int, *, shows_processors: bool = False
) -> SettingCount:
    """Count the settings that are still to be run.

    Args:
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
    """Return the experiment with its load's part of what a setting may take with all loads that share it.

    A load may take what those before it left, but for the least that a setting takes with those after it. A budget
    that is no longer than the least of all has parts in proportion to these.

    Args:
        experiment: What is measured; its budget is that of all its loads.
    """
    budget, number = experiment.budget, experiment.loads.index(experiment.load)
    least = [least_ms(experiment, load, window_ms) for load in experiment.loads]
    share = min(1.0, budget.most_ms / sum(least))
    budget = replace(budget, most_ms=budget.most_ms - share * sum(least[number + 1 :]), least_ms=share * least[number])
    return replace(experiment, budget=budget)


def least_ms(experiment: Experiment, load: Interference, window_ms: float, earlier: Sequence[Setting] = ()) -> float:
    """Say how long a setting of a search takes at least.

    Args:
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


def forecast(least_ms: float, most_ms: float) -> str:
    """Return a duration to come, such as `2 min to about 9 min`.

    Args:
        least_ms: 0 if unknown.
        most_ms: Infinite if unknown.
    """
    least, most = show_duration(least_ms), "" if most_ms == inf else f"about {show_duration(most_ms)}"
    if not most:
        return f"at least {least}" if least_ms else ""
    if least_ms <= 0:
        return f"at most {most}"
    return most if most == f"about {least}" else f"{least} to {most}"


def time_of_settings(
    experiment: Experiment,
    count: SettingCount,
    earlier: Sequence[Setting],
    seconds: Sequence[float],
    window_ms: float,
) -> tuple[float, float]:
    """Return the least and the longest time of the settings in ms; 0 and infinite if unknown.

    Args:
        seconds: That comparable settings of this command took; they alone count on a simulated host.
    """
    is_simulated = experiment.host.provider is ProviderKind.SIMULATED
    spent = [_spent_again_ms(experiment, setting, count) for setting in earlier if setting.spent_ms is not None]
    times = [1000 * each for each in seconds] if is_simulated or not spent else spent
    least, most = 0.0, inf
    if times:
        least, most = count.least * min(times), count.most * max(times)
    elif not is_simulated:
        least = count.least * _shortest_ms(experiment, count, earlier, window_ms)
        timed = [float(until.time) for each in experiment.members if isinstance(until := run_of(each).until, Elapsed)]
        if least and count.goes_on:
            most = count.most * max(experiment.budget.most_ms, least, *timed)
    return least, most


def describe_settings(experiment: Experiment, count: SettingCount, times: tuple[float, float]) -> str:
    """Return the line with the number of settings and how long they take, as far as that is known.

    Args:
        times: as of `time_of_settings`.
    """
    settings = counted(count.most, "setting")
    if count.least != count.most:
        settings = f"{count.least} to {settings}"
    later = len(experiment.loads) - 1 - experiment.loads.index(experiment.load)
    then = f"; then {counted(later, 'more load')}" if later else ""
    subject = f"{experiment.name} with {experiment.setup.interference} on {experiment.host.name}"
    simulated = " (simulated)" if experiment.host.provider is ProviderKind.SIMULATED else ""
    return f"{subject}{simulated}: {', '.join(filter(None, (settings, forecast(*times))))}{then}."


@dataclass(slots=True, kw_only=True)
class Announced:
    """The longest time that was printed for some work. It says once that this time has passed."""

    work: str  # the subject of that sentence, such as `The proof on onboard`
    most_ms: float  # by the clock of `add` and `look`; infinite: none was printed
    say: Callable[[str], None]
    spent_ms: float = 0.0

    def add(self, spent_ms: float) -> None:
        """Count the time of a part that ended."""
        self.spent_ms += spent_ms
        self.look(0.0)

    def look(self, running_ms: float) -> None:
        """Compare the time so far, with that of the running part."""
        if self.spent_ms + running_ms > self.most_ms:
            self.say(f"{self.work} takes longer than the announced {show_duration(self.most_ms)}.")
            self.most_ms = inf


def nothing_announced() -> Announced:
    """Return the bound of work for which no longest time was printed."""
    return Announced(work="", most_ms=inf, say=lambda _: None)


def _shortest_ms(experiment: Experiment, count: SettingCount, earlier: Sequence[Setting], window_ms: float) -> float:
    """Return the least duration of a setting; members run together, each as long as it needs. 0: unknown."""
    if count.goes_on:
        return least_ms(experiment, experiment.load, window_ms, earlier)
    shortest = max(_least_ms(run_of(member), member, earlier, count) for member in experiment.members)
    settles_ms = MEMORY_FACTOR * window_ms
    return settles_ms + max(shortest, settles_ms)


def _spent_again_ms(experiment: Experiment, setting: Setting, count: SettingCount) -> float:
    """Return the time that an earlier setting would take now.

    A setting that ends after a number of samples takes time in proportion to them.
    """
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

    Returns:
        `run.until`, where that is a number and larger; what jitter needs is known only after a first setting.
    """
    until = run_of(member).until
    needed = max((samples_needed(index, threshold) for index, threshold in member.apt.items()), default=FIRST_LOOK)
    return max(needed, until.samples) if isinstance(until, SampleCount) else needed


def _least_ms(run: Run, member: Component, earlier: Sequence[Setting], count: SettingCount) -> float:
    """Return a setting of a search may end as soon as its samples tell, a setting of a sweep goes on to its end."""
    between = float(run.arrival.period) if isinstance(run.arrival, Periodic) else _fastest_ms(member.name, earlier)
    if count.goes_on:
        return least_samples(member) * between
    if isinstance(run.ends, Elapsed):
        return min(float(run.ends.time), FIRST_LOOK * between if count.ends_early else inf)
    return (min(FIRST_LOOK, run.ends.samples) if count.ends_early else run.ends.samples) * between


def _fastest_ms(name: str, earlier: Sequence[Setting]) -> float:
    """Return the time of a job, on the average of the setting where it was least; 0 where nothing is recorded."""
    paces = [
        series.elapsed_ms / len(series.samples)
        for setting in earlier
        for series in setting.series
        if series.component == name and series.samples
    ]
    return min(paces, default=0.0)


@dataclass(frozen=True, slots=True, kw_only=True)
class WallTimes:
    """The times of the settings that this command ran."""

    clock: Callable[[], float] = time.monotonic  # seconds, from any start
    _seconds: list[tuple[Experiment, float]] = field(default_factory=list)  # as they ended

    def add(self, experiment: Experiment, seconds: float) -> None:
        """Keep what a setting took that was recorded.

        Args:
            seconds: From its start to its end, with all tries of one that was disturbed.
        """
        self._seconds.append((experiment, seconds))

    def comparable(self, experiment: Experiment) -> Sequence[float]:
        """Return the times, in seconds, that tell how long a setting of an experiment will take.

        Returns:
            Those of the same components on the same host, with any load. Where there are none: for a simulated host
            those of other components there, then those on all simulated hosts, since it is this machine that is waited
            for; for others nothing, as each component has its own pace.
        """
        host, name = experiment.host, experiment.name
        on_host = [(run.name, seconds) for run, seconds in self._seconds if run.host.name == host.name]
        same = [seconds for of, seconds in on_host if of == name]
        if same or host.provider is not ProviderKind.SIMULATED:
            return same
        on_simulated = [seconds for run, seconds in self._seconds if run.host.provider is ProviderKind.SIMULATED]
        return [seconds for _, seconds in on_host] or on_simulated

    def remaining(
        self, experiment: Experiment, count: SettingCount | None, ended: int, *, running: int
    ) -> RemainingSettings | None:
        """Say what is left of an experiment.

        Args:
            count: So many settings it asks for at least and at most; None: that was not said.
            running: How many of the others run, 0 or 1.

        Returns:
            None: no setting of this command shows how long one takes, or the count is not known.
        """
        seconds = self.comparable(experiment)
        if count is None or not seconds:
            return None
        least, most = max(running, count.least - ended), count.most - ended
        return RemainingSettings(least=least, most=most, setting_seconds=fmean(seconds))
