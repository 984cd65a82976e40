"""How long the settings of one command took on this machine, and how much is left by that; kept in memory alone.

A data log has the times of the host's own clock: a simulated host's says nothing of how long its user waits.
"""

import time
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from statistics import fmean

from rarms_iac.app.control import RemainingSettings
from rarms_iac.measuring.strategies import SettingCount
from rarms_iac.model.experiment import Experiment
from rarms_iac.model.host import ProviderKind


@dataclass(frozen=True, slots=True, kw_only=True)
class WallTimes:
    """What each setting took that was run in this command."""

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
            Those of the same components on the same host, beside any load. Where there are none: for a simulated host
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
            ended: How many of them are over.
            running: How many of the others run, 0 or 1.

        Returns:
            None: no setting of this command tells how long one takes, or the count is not known.
        """
        seconds = self.comparable(experiment)
        if count is None or not seconds:
            return None
        least, most = max(running, count.least - ended), count.most - ended
        return RemainingSettings(least=least, most=most, setting_seconds=fmean(seconds))
