"""What measuring tells a person while it goes on."""

from collections.abc import Mapping

from rarms_iac.measuring.setup import Experiment
from rarms_iac.measuring.wall_times import RemainingSettings
from rarms_iac.model.quantities import ReservePercent
from rarms_iac.model.series import Series
from rarms_iac.model.setting import Setting


class MeasuringReporter:
    """Told what happens, as it happens; must not raise. This one drops what it is told."""

    def experiment_started(self, experiment: Experiment, recorded: tuple[Setting, ...]) -> None:
        """Measuring begins, or goes on after the settings that are recorded.

        Args:
            experiment: what is measured.
            recorded: its settings so far.
        """

    def setting_started(
        self, experiment: Experiment, reserve: ReservePercent, remaining: RemainingSettings | None
    ) -> None:
        """The setting of this CR begins.

        Args:
            experiment: what is measured.
            reserve: the CR in per cent of P1's own processors.
            remaining: what the experiment still asks for, with this setting; None: nothing tells yet how long it takes.
        """

    def samples_came(self, experiment: Experiment, reserve: ReservePercent, seen: Mapping[str, Series]) -> None:
        """Some samples more were seen.

        Args:
            experiment: what is measured.
            reserve: the CR in per cent of P1's own processors.
            seen: by component, the series so far.
        """

    def setting_ended(self, experiment: Experiment, setting: Setting, remaining: RemainingSettings | None) -> None:
        """The setting is recorded.

        Args:
            experiment: what is measured.
            setting: as it is recorded.
            remaining: what the experiment may still ask for after it, likewise.
        """

    def setting_disturbed(self, experiment: Experiment, reserve: ReservePercent, reason: str) -> None:
        """The setting of this CR was disturbed, and is measured once more.

        Args:
            experiment: what is measured.
            reserve: the CR in per cent of P1's own processors.
            reason: what disturbed it, in words.
        """

    def experiment_ended(self) -> None:
        """There is nothing more to run."""
