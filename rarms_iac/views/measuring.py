"""Progress while something is measured: a line a setting; on a terminal the running one moves."""

from collections.abc import Callable, Mapping

from rarms_iac.measuring.findings import show_index, show_value
from rarms_iac.measuring.performance import MeasuredIndex, indexes_of_series, measured_indexes
from rarms_iac.measuring.setup import Experiment
from rarms_iac.model.measurement import Series, Setting
from rarms_iac.model.system import Elapsed, SampleCount
from rarms_iac.views.diagnostics.layout import hanging, wrap
from rarms_iac.views.diagnostics.text import counted
from rarms_iac.views.progress import WRITE_OVER, fitting, seconds

SHORT = {"mean_response_time": "mean", "maximum_response_time": "maximum", "minimum_response_time": "minimum"}


class MeasuringProgress:
    """A `MeasuringReporter` that writes to a person.

    Args:
        write: takes a piece of text and shows it at once.
        clock: seconds, from any start.
        lively: lines may be written over; otherwise every line is whole, and nothing is written twice.
        width: columns of the terminal.
    """

    def __init__(self, write: Callable[[str], None], clock: Callable[[], float], *, lively: bool, width: int) -> None:
        self._write = write
        self._clock = clock
        self._lively = lively
        self._width = width
        self._since = 0.0

    def experiment_started(self, experiment: Experiment, recorded: tuple[Setting, ...]) -> None:
        """Say what begins, and what is known of it already."""
        known = f", {counted(len(recorded), 'setting')} recorded already" if recorded else ""
        setup = experiment.setup
        begins = f"{experiment.name} on {experiment.host.name} against {setup.interference}{known}"
        self._write("".join(f"{line}\n" for line in wrap(begins, self._width, "")))

    def setting_started(self, experiment: Experiment, reserve: int, number: int) -> None:  # noqa: ARG002 - named above
        """Show the running setting where it can be written over."""
        self._since = self._clock()
        if self._lively:
            self._write(WRITE_OVER + fitting(f"  {reserve:>3} %  ...", self._width))

    def looked(self, experiment: Experiment, reserve: int, seen: Mapping[str, Series]) -> None:
        """How many samples there are, what they come to, and how long it may yet take."""
        if self._lively:
            values = brief(indexes_of_series(experiment.members, seen), several=len(experiment.members) > 1)
            left = self._left(experiment, seen)
            says = fitting(f"  {reserve:>3} %  {samples_of(seen)}, {values}", self._width - len(left))
            self._write(WRITE_OVER + fitting(says + left, self._width))

    def setting_ended(self, experiment: Experiment, setting: Setting) -> None:
        """What was measured there."""
        seen = {series.component: series for series in setting.series}
        found = measured_indexes(setting, experiment)
        several = len(experiment.members) > 1
        told = "; ".join(f"{whose(one, several=several)}{show_index(one)}" for one in found) or "measured"
        took = seconds(self._clock() - self._since)
        lines = hanging(f"  {setting.reserve:>3} %  ", f"{samples_of(seen)}, {told}, in {took}", self._width)
        self._write((WRITE_OVER if self._lively else "") + "".join(f"{line}\n" for line in lines))

    def experiment_ended(self) -> None:
        """Leave no half line behind; what came of it stands in the summary."""
        if self._lively:
            self._write(WRITE_OVER)

    def _left(self, experiment: Experiment, seen: Mapping[str, Series]) -> str:
        done = done_of(experiment, seen)
        took = self._clock() - self._since
        if not 0 < done < 1 or took < 1:
            return ""
        return f", at most {seconds(took * (1 - done) / done)} left"


def done_of(experiment: Experiment, seen: Mapping[str, Series]) -> float:
    """How much of the longest that a setting may take is done, 1 at its end."""
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


def whose(shown: MeasuredIndex, *, several: bool) -> str:
    """Whose index it is, where several components are measured together; with a space behind it."""
    return f"{shown.component} " if several else ""


def brief(found: tuple[MeasuredIndex, ...], *, several: bool = False) -> str:
    """The values alone: `mean 94.1 ms, success_rate 98 %`; of several components `vision mean 94.1 ms`."""
    values = [
        f"{whose(one, several=several)}{SHORT.get(one.index, one.index)} {show_value(one.index, one.estimate.value)}"
        for one in found
        if one.estimate is not None
    ]
    return ", ".join(values) or "nothing to tell yet"
