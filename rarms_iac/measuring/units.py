"""Units of work of `rarms measure`: a partition with one load. Each is reported when it ends. Begin at `Units`."""

from collections.abc import Collection, Sequence
from dataclasses import dataclass, field
from math import isinf

from rarms_iac.app.control import FinishedUnit, MeasuringReporter, UnitEnding, UnitValue, WorkBegun
from rarms_iac.measuring.duration import forecast, settings_to_run
from rarms_iac.measuring.evidence import measured_indexes
from rarms_iac.measuring.measure_request import ExperimentResult
from rarms_iac.measuring.search.bracketing import MOST
from rarms_iac.measuring.strategies import FirstPass
from rarms_iac.model.experiment import Experiment
from rarms_iac.model.host import ProviderKind
from rarms_iac.model.outcomes import NotAchievable, SettingFailed, Stopped, Sufficient, Swept
from rarms_iac.model.quantities import guaranteed
from rarms_iac.model.run import Periodic
from rarms_iac.statistics.first_look import LEAST_SAMPLES, LONGEST_MS, point_estimate
from rarms_iac.texts.messages import counted, in_a_row


@dataclass(slots=True, kw_only=True)
class Units:
    """The units of one pass, as they end."""

    reporter: MeasuringReporter
    of: int
    more_follows: bool = False
    longest_ms: float | None = None  # of one unit, by the user's clock; None: unknown
    later_ms: float = 0.0  # longest time of the passes that follow
    _ended: int = field(default=0)

    def __post_init__(self) -> None:
        work = WorkBegun(units=self.of, more_follows=self.more_follows, unit_ms=self.longest_ms, later_ms=self.later_ms)
        self.reporter.work_begun(work)

    def add(self, result: ExperimentResult) -> None:
        """Report that a unit has its result; one that was stopped is none."""
        if isinstance(result.conclusion, Stopped):
            return
        self._ended += 1
        self.reporter.unit_ended(unit_of(result, self._ended, max(self.of, self._ended)))


def unit_of(result: ExperimentResult, number: int, of: int) -> FinishedUnit:
    """Return the report of a unit: its answer, with the values measured there."""
    conclusion, setup = result.conclusion, result.experiment.setup
    at = conclusion.reserve if isinstance(conclusion, Sufficient | NotAchievable | SettingFailed) else None
    return FinishedUnit(
        number=number,
        of=of,
        subject=result.experiment.name,
        load=setup.interference,
        reserved_lp=None if at is None else guaranteed(at, setup.processors),
        values=() if at is None else _values(result, at),
        ending=_ending(result),
    )


def unit_of_question(
    result: ExperimentResult, reserve: int, worse: Collection[str], *, unresolved: bool, number: int, of: int
) -> FinishedUnit:
    """Return the report of a setting that tuning asked for, under one load.

    Args:
        worse: the components that were not shown to meet their thresholds.
        unresolved: none of them was shown to miss one.
    """
    shown = [each for each in _values(result, reserve) if not worse or each.component in worse]
    return FinishedUnit(
        number=number,
        of=max(of, number),
        subject=result.experiment.name,
        load=result.interference,
        reserved_lp=guaranteed(reserve, result.experiment.setup.processors),
        values=tuple(shown),
        ending="inconclusive" if unresolved else "missed" if worse else "met",
    )


def _ending(result: ExperimentResult) -> UnitEnding:
    match result.conclusion:
        case Sufficient() if result.is_weak:
            return "no answer"
        case Sufficient():
            return "provisional" if result.is_provisional else "met"
        case NotAchievable():
            return "missed"
        case SettingFailed():
            return "too many failed samples"
        case Swept():
            return "measured"
        case _:
            return "no answer" if result.is_provisional else "inconclusive"


def _values(result: ExperimentResult, reserve: int) -> tuple[UnitValue, ...]:
    found = []
    for setting in (setting for setting in result.settings if setting.reserve == reserve):
        for index in measured_indexes(setting, result.experiment):
            series = next(each for each in setting.series if each.component == index.component)
            estimated = point_estimate(index.index, series, result.experiment.runs[index.component])
            value = None if index.estimate is None else index.estimate.value
            if result.is_provisional and estimated is not None:
                value = None if isinf(estimated.value) else estimated.value
            if value is not None and index.threshold is not None:
                found.append(
                    UnitValue(index=index.index, value=value, threshold=index.threshold, component=index.component)
                )
    return tuple(found)


USUAL_MS, USUAL_FURTHER_MS = 45_000, 15_000
"""The host's time that the first pass takes for a partition with one load, and with each further one: the medians of
random components."""

START_AND_STOP_MS = 5_000
"""The time for the start and the stop of components and loads, in a setting of the first pass."""


def describe_work(groups: Sequence[Sequence[Experiment]], *, quick: bool) -> str:
    """Return the sentence with which measuring begins: how much there is, and how long it takes.

    Args:
        groups: the experiments of each partition, one a load.
        quick: there is only the first pass.
    """
    hosts = {group[0].host.name: is_simulated(group) for group in groups}
    names = in_a_row([f"{name} (simulated)" if simulated else name for name, simulated in hosts.items()])
    components = counted(sum(len(group[0].setup.members) for group in groups), "component")
    most_loads = max(len(group) for group in groups)
    loads = f" x {most_loads} loads" if most_loads > 1 else ""
    usual_ms = sum(USUAL_MS + USUAL_FURTHER_MS * (len(group) - 1) for group in groups)
    clock = " of host time" if any(hosts.values()) else ""  # a simulated host's clock is not the user's
    return f"Measuring {components}{loads} on {names}: {forecast(usual_ms, longest_ms(groups, quick=quick))}{clock}."


def is_simulated(group: Sequence[Experiment]) -> bool:
    """Tell whether the time of these experiments is not the user's."""
    return group[0].host.provider is ProviderKind.SIMULATED


def longest_ms(groups: Sequence[Sequence[Experiment]], *, quick: bool) -> float:
    """Return the longest time of all passes, by the clocks of the hosts: each asks for all settings that it may."""
    first = sum(len(group) * longest_first_ms(group) for group in groups)
    return first if quick else first + sum(len(group) * longest_later_ms(group) for group in groups)


def longest_first_ms(group: Sequence[Experiment]) -> float:
    """Return the longest time of a partition with one load in the first pass.

    A setting ends at `LONGEST_MS`, or with `LEAST_SAMPLES` of a long period.
    """
    settings = settings_to_run(FirstPass(), (), 100, shows_processors=not group[0].fixes_processors).most
    periods = [float(run.arrival.period) for run in group[0].runs.values() if isinstance(run.arrival, Periodic)]
    start_ms = 0 if is_simulated(group) else START_AND_STOP_MS
    return settings * (max(LONGEST_MS, LEAST_SAMPLES * max(periods, default=0.0)) + start_ms)


def longest_later_ms(group: Sequence[Experiment]) -> float:
    """Return the longest time of a partition with one load in the later passes: each setting uses its whole budget."""
    return MOST * group[0].budget.most_ms


def describe_missing_part(host: str, loads: Sequence[str]) -> str:
    """Return the sentence on loads that run in fewer partitions than usual, as the host has no memory for all."""
    return f"{host} does not have enough memory for all load partitions of {in_a_row(list(dict.fromkeys(loads)))}."


def describe_processors(results: Sequence[ExperimentResult]) -> str:
    """Return the numbers of processors that components use where these are not the host's; empty: none differs."""
    by_number: dict[int, list[str]] = {}
    for result in results:
        if not result.experiment.fixes_processors and result.processors < result.experiment.host.logical_processors:
            by_number.setdefault(result.processors, []).append(result.experiment.name)
    if not by_number:
        return ""
    for number, names in by_number.items():
        if 1 < len(names) == len(results):
            return f"Each uses {counted(number, 'processor')}: measuring with {counted(number, 'VP')}."
    words = [f"{in_a_row(names)} {counted(number, 'VP')}" for number, names in sorted(by_number.items())]
    return f"Processors in use: {'; '.join(words)}."
