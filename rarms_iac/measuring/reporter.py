"""What is told while something is measured; the default is silent and complete."""

from collections.abc import Mapping
from typing import Protocol

from rarms_iac.measuring.setup import Experiment
from rarms_iac.model.measurement import Series, Setting


class MeasuringReporter(Protocol):
    """Told what happens, as it happens; must not raise."""

    def experiment_started(self, experiment: Experiment, recorded: tuple[Setting, ...]) -> None:
        """Measuring begins, or goes on after the settings that are recorded."""
        ...

    def setting_started(self, experiment: Experiment, reserve: int, number: int) -> None:
        """The setting of this CR begins; it is the number-th, from 1."""
        ...

    def looked(self, experiment: Experiment, reserve: int, seen: Mapping[str, Series]) -> None:
        """Some samples more were seen."""
        ...

    def setting_ended(self, experiment: Experiment, setting: Setting) -> None:
        """The setting is recorded."""
        ...

    def experiment_ended(self) -> None:
        """There is nothing more to run."""
        ...


class Silent:
    """Tells nobody."""

    def experiment_started(self, experiment: Experiment, recorded: tuple[Setting, ...]) -> None:
        """Nothing."""

    def setting_started(self, experiment: Experiment, reserve: int, number: int) -> None:
        """Nothing."""

    def looked(self, experiment: Experiment, reserve: int, seen: Mapping[str, Series]) -> None:
        """Nothing."""

    def setting_ended(self, experiment: Experiment, setting: Setting) -> None:
        """Nothing."""

    def experiment_ended(self) -> None:
        """Nothing."""
