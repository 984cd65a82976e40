"""Progress while something is measured: in place on a terminal, a line now and then in a pipe."""

from collections.abc import Callable, Mapping, Sequence
from typing import TYPE_CHECKING

from rarms_iac.measuring.findings import show_index, show_value
from rarms_iac.measuring.performance import MeasuredIndex, indexes_of_series, measured_indexes
from rarms_iac.measuring.setup import Experiment
from rarms_iac.model.measurement import Series, Setting
from rarms_iac.model.system import Elapsed, SampleCount
from rarms_iac.views.console import counted, paragraph, show_seconds
from rarms_iac.views.live_table import LiveTable

if TYPE_CHECKING:
    from rich.console import RenderableType

BETWEEN_LINES = 10.0
"""Seconds from one line of progress to the next where nothing can be updated in place."""


class MeasuringProgress:
    """A `MeasuringReporter` that writes to a person.

    Args:
        say: writes a line for good.
        clock: seconds, from any start.
        live: the table that is updated in place; None: lines are written, at most one in `BETWEEN_LINES`.
    """

    def __init__(
        self, say: Callable[["RenderableType"], None], clock: Callable[[], float], live: LiveTable | None = None
    ) -> None:
        self._say = say
        self._clock = clock
        self._live = live
        self._began = 0.0
        self._said = clock()

    def experiment_started(self, experiment: Experiment, recorded: tuple[Setting, ...]) -> None:
        """Show nothing yet: the first setting names what is measured."""

    def setting_started(self, experiment: Experiment, reserve: int, number: int) -> None:  # noqa: ARG002 - a reserve says more
        """Show the running setting where it can be updated."""
        self._began = self._clock()
        if self._live is not None:
            self._live.show((experiment.name, f"{reserve} %", "..."))

    def looked(self, experiment: Experiment, reserve: int, seen: Mapping[str, Series]) -> None:
        """Show how many samples there are, what they come to, and how long it may yet take."""
        if self._live is not None:
            values = brief(indexes_of_series(experiment.members, seen), several=len(experiment.members) > 1)
            progress = f"{samples_of(seen)}, {values}{self._time_left(experiment, seen)}"
            self._live.show((experiment.name, f"{reserve} %", progress))

    def setting_ended(self, experiment: Experiment, setting: Setting) -> None:
        """Say what was measured there, where the last line is long ago."""
        now = self._clock()
        if self._live is not None or now - self._said < BETWEEN_LINES:
            return
        self._said = now
        series = {series.component: series for series in setting.series}
        several = len(experiment.members) > 1
        values = "; ".join(
            f"{_owner(index, several=several)}{show_index(index)}" for index in measured_indexes(setting, experiment)
        )
        took = show_seconds(now - self._began)
        self._say(
            paragraph(
                f"{experiment.name} at {setting.reserve} %: {samples_of(series)}, {values or 'measured'}, in {took}"
            )
        )

    def experiment_ended(self) -> None:
        """Leave no half line behind; what came of it stands in the summary."""
        if self._live is not None:
            self._live.hide()

    def _time_left(self, experiment: Experiment, seen: Mapping[str, Series]) -> str:
        done = share_done(experiment, seen)
        took = self._clock() - self._began
        if not 0 < done < 1 or took < 1:
            return ""
        return f", at most {show_seconds(took * (1 - done) / done)} left"


def share_done(experiment: Experiment, seen: Mapping[str, Series]) -> float:
    """Return how much of the longest that a setting may take is done, 1 at its end."""
    parts = []
    for name, run in experiment.runs.items():
        match run.until:
            case SampleCount(samples=samples):
                parts.append(len(seen[name].samples) / samples)
            case Elapsed(time=time):
                parts.append(seen[name].elapsed_ms / float(time))
    return min(parts)


def samples_of(seen: Mapping[str, Series]) -> str:
    """`143 samples`; of several components the fewest."""
    return counted(min((len(series.samples) for series in seen.values()), default=0), "sample")


def brief(indexes: Sequence[MeasuredIndex], *, several: bool = False) -> str:
    """The values alone: `mean_response_time 94.1 ms`; of several components `vision mean_response_time 94.1 ms`."""
    values = [
        f"{_owner(index, several=several)}{index.index} {show_value(index.index, index.estimate.value)}"
        for index in indexes
        if index.estimate is not None
    ]
    return ", ".join(values) or "nothing to tell yet"


def _owner(index: MeasuredIndex, *, several: bool) -> str:
    return f"{index.component} " if several else ""
