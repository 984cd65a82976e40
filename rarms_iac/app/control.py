"""How a caller takes part while a use case works: it hears what goes on, may end it, and is asked; by default not."""

from collections.abc import Callable, Mapping, Sequence
from contextlib import AbstractContextManager, nullcontext
from dataclasses import dataclass
from fractions import Fraction
from typing import Literal, Protocol

from rarms_iac.applying.run_report import RunReporter
from rarms_iac.model.diagnostics import Diagnostic, Sources
from rarms_iac.model.experiment import Experiment
from rarms_iac.model.quantities import ReservePercent
from rarms_iac.model.series import Series
from rarms_iac.model.setting import Setting
from rarms_iac.model.system import Threshold


class StopSignal(Protocol):
    """Says whether the work is to end."""

    def should_stop(self) -> bool:
        """Tell whether the work ends at the next safe place; asked between steps and settings, so it must be quick.

        Once it is True it stays so.
        """
        return False

    def gently(self) -> AbstractContextManager[None]:
        """Return a context for the change of a host: inside, a request to stop waits for `should_stop` to be asked."""
        return nullcontext()


class NeverStop(StopSignal):
    """No end is asked for."""


@dataclass(frozen=True, slots=True, kw_only=True)
class RemainingSettings:
    """The number of settings that an experiment still asks for, and the time that one took so far in this command."""

    least: int  # the running setting is one of them
    most: int
    setting_seconds: float  # on the average, by a wall clock, with all tries of one that was disturbed


@dataclass(frozen=True, slots=True, kw_only=True)
class WorkBegun:
    """The beginning of several units of work, such as the pass of a measurement."""

    units: int
    more_follows: bool = False  # a later pass measures the same again, more precisely
    at_most: bool = False  # answers may end the work earlier
    unit_ms: float | None = None  # longest time of a unit, by the user's clock; None: unknown
    later_ms: float = 0.0  # longest time of later passes


UnitEnding = Literal["met", "provisional", "missed", "inconclusive", "no answer", "measured", "too many failed samples"]


@dataclass(frozen=True, slots=True, kw_only=True)
class UnitValue:
    """A measured value with its threshold, both in the index's unit."""

    index: str
    value: float
    threshold: Threshold
    component: str


@dataclass(frozen=True, slots=True, kw_only=True)
class FinishedUnit:
    """A unit of work with its result: components with one load."""

    number: int  # from 1
    of: int  # of tuning at most; it falls as answers rule out others
    subject: str  # the components
    load: str  # empty: none
    reserved_lp: Fraction | None = None  # the answer; None: there is none
    values: tuple[UnitValue, ...] = ()  # with that reservation
    ending: UnitEnding


class MeasuringReporter:
    """Receives events as they happen; must not raise. This one drops them."""

    def work_begun(self, work: WorkBegun) -> None:
        """Report that so many units of work begin."""

    def unit_ended(self, unit: FinishedUnit) -> None:
        """Report that a unit of work has its result."""

    def experiment_started(self, experiment: Experiment, recorded: tuple[Setting, ...]) -> None:
        """Report that measuring begins, or continues after the recorded settings."""

    def setting_started(
        self, experiment: Experiment, reserve: ReservePercent, remaining: RemainingSettings | None
    ) -> None:
        """Report that the setting of this CR begins.

        Args:
            remaining: what the experiment still asks for, with this setting; None: its duration is not known yet.
        """

    def samples_came(self, experiment: Experiment, reserve: ReservePercent, seen: Mapping[str, Series]) -> None:
        """Report more samples."""

    def setting_ended(self, experiment: Experiment, setting: Setting, remaining: RemainingSettings | None) -> None:
        """Report that the setting is recorded.

        Args:
            remaining: what the experiment may still ask for after it, likewise.
        """

    def setting_disturbed(self, experiment: Experiment, reserve: ReservePercent, reason: str) -> None:
        """Report that the setting of this CR was disturbed, and is measured again."""

    def proof_samples_came(self, host: str, load: str | None, seen: Mapping[str, Series]) -> None:
        """Report more samples of a layout that is being proven.

        Args:
            load: its name; None: the layout runs without one.
            seen: by component, the series so far, of all starts.
        """

    def experiment_ended(self) -> None:
        """Report that nothing more runs."""


class Reporter(Protocol):
    """Hears what goes on. It must not raise, and nothing waits for an answer of it."""

    @property
    def steps(self) -> RunReporter:
        """Hears of each step of an apply, an undo, or a run that is finished."""

    @property
    def settings(self) -> MeasuringReporter:
        """Hears of each setting that is measured."""

    def message(self, text: str) -> None:
        """Show one or more whole sentences about the work done, without a line end.

        Args:
            text: for a person; not wrapped yet.
        """

    def findings(self, diagnostics: Sequence[Diagnostic], sources: Sources | None = None) -> None:
        """Report findings that do not end the work.

        Args:
            diagnostics: in any order; may be empty.
        """


class SilentAppReporter:
    """A `Reporter` that keeps everything to itself."""

    steps: RunReporter = RunReporter()
    settings: MeasuringReporter = MeasuringReporter()

    def message(self, text: str) -> None:
        pass

    def findings(self, diagnostics: Sequence[Diagnostic], sources: Sources | None = None) -> None:
        pass


StopConsent = Callable[[str, tuple[str, ...]], bool]
"""Whether these partitions of a host may be stopped while it is measured: asked once a host, before the first."""


def never_consents(_host: str, _partitions: tuple[str, ...]) -> bool:
    """Stop nothing: the measurement is refused."""
    return False


def always_consents(_host: str, _partitions: tuple[str, ...]) -> bool:
    """Stop what runs, as the options ask for."""
    return True


@dataclass(frozen=True, slots=True, kw_only=True)
class Control:
    """The caller's part in a use case that changes a host, or measures on it."""

    reporter: Reporter = SilentAppReporter()
    stop: StopSignal = NeverStop()  # asked after each step, between settings and while samples come
    consents: StopConsent = never_consents  # to measure; they start again afterwards, however it ends


UNATTENDED = Control()
"""No report, no early end, and no partition is stopped."""
