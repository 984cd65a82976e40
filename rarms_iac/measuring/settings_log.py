"""The settings of an experiment: in its data log, and as a run of the loop knows them."""

from collections.abc import Callable
from dataclasses import dataclass, field, replace
from pathlib import Path

from rarms_iac.model.host import ProviderKind
from rarms_iac.model.quantities import ReservePercent
from rarms_iac.model.setting import Setting, join_settings
from rarms_iac.storage.datalog.files import append_setting, read_log
from rarms_iac.storage.datalog.log import Header, Provenance, Recorded
from rarms_iac.storage.datalog.staleness import present_log


@dataclass(frozen=True, slots=True, kw_only=True)
class SettingsLog:
    """The data log of an experiment: the first setting begins the file, or adds a header to it."""

    path: Path
    header: Header
    provenance: Callable[[Setting], Provenance]  # of what is recorded now
    remeasure_seed: int | None = (
        None  # a strategy sees reservations only once they were measured with this seed; None: all
    )

    @property
    def is_simulated(self) -> bool:
        """Whether samples are drawn from seeds."""
        return self.header.platform_facts.provider is ProviderKind.SIMULATED

    def runs(self) -> tuple[Setting, ...]:
        """Read all that count, each run by itself, in the order in which they were recorded.

        Returns:
            Those with as many processors as the header has; none where there is no log yet, or nothing of it holds.

        Raises:
            LogUnreadable: the file is no whole data log.
        """
        file, own = read_log(self.path), self.header
        if file is None:
            return ()
        log = present_log(file, own.setup.members, own.identity, own.platform_facts).log
        if log is None:
            return ()
        return tuple(record.setting for record in log.of(self.header.setup.processors).counting)

    def settings(self) -> tuple[Setting, ...]:
        """Join what counts to one setting a reservation (`join_settings`).

        Returns:
            One setting for each reservation, in the order in which they were first recorded; none before the file is
                begun, or where nothing of it holds.

        Raises:
            LogUnreadable: the file is no whole data log.
        """
        return join_settings(self.runs(), simulated=self.is_simulated)

    def add(self, setting: Setting) -> None:
        """Record a setting, whole or not at all; it is on the disk when this returns.

        Args:
            setting: one that is not in the log.

        Raises:
            LogUnreadable: the file is no whole data log.
            OSError: it cannot be written.
        """
        append_setting(self.path, self.header, Recorded(setting=setting, provenance=self.provenance(setting)))


@dataclass(frozen=True, slots=True, kw_only=True)
class KnownSettings:
    """What was measured, each run by itself, and joined to one setting a reservation."""

    runs: tuple[Setting, ...]
    simulated: bool
    joined: dict[int, Setting] = field(default_factory=dict)  # by reserve, what `at` worked out

    @property
    def settings(self) -> tuple[Setting, ...]:
        """One setting a reservation, in the order in which they were first measured."""
        return tuple(map(self.at, dict.fromkeys(run.reserve for run in self.runs)))

    def seen_with(self, seed: int | None) -> tuple[Setting, ...]:
        """Select the settings that were measured with this seed.

        Args:
            seed: None for all.

        Returns:
            Each with all that counts at its reservation.
        """
        reserves = {run.reserve for run in self.runs if seed is None or run.seed == seed}
        return tuple(setting for setting in self.settings if setting.reserve in reserves)

    def at(self, reserve: ReservePercent) -> Setting:
        """Join the runs of a reservation that was measured.

        NOTE: once, since estimates are kept with the samples that they are made of.

        Args:
            reserve: the CR in per cent of P1's own processors.
        """
        if reserve not in self.joined:
            self.joined[reserve] = self.joined_with(reserve)
        return self.joined[reserve]

    def joined_with(self, reserve: ReservePercent, *more: Setting) -> Setting:
        """Join the runs of a reservation with more.

        Args:
            reserve: the CR in per cent of P1's own processors.
            more: runs that are not recorded yet.
        """
        runs = [run for run in self.runs if run.reserve == reserve]
        (joined,) = join_settings((*runs, *more), simulated=self.simulated)
        return joined

    def spent_ms(self, reserve: ReservePercent, seed: int) -> float:
        """Sum the host's time that was spent on a reservation before.

        Args:
            reserve: the CR in per cent of P1's own processors.
            seed: of the run that follows: a simulated host goes through the time of the same seed again.

        Returns:
            Milliseconds.
        """
        runs = [run for run in self.runs if run.reserve == reserve and not (self.simulated and run.seed == seed)]
        return join_settings(runs, simulated=self.simulated)[0].host_ms if runs else 0.0

    def with_run(self, run: Setting) -> "KnownSettings":
        """Return these and one run more.

        Args:
            run: as it was recorded.
        """
        joined = {reserve: setting for reserve, setting in self.joined.items() if reserve != run.reserve}
        return replace(self, runs=(*self.runs, run), joined=joined)
