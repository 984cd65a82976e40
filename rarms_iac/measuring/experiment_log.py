"""The data log of an experiment: where it lies, whether it still holds, and its settings as a search knows them."""

from collections.abc import Iterable, Sequence
from contextlib import suppress
from dataclasses import dataclass, field, replace
from pathlib import Path

from rarms_iac.app.data_logs import files_of, subject_of
from rarms_iac.app.hosts import Hosts
from rarms_iac.app.measurement_files import log_errors, now
from rarms_iac.measuring.evidence import is_weak
from rarms_iac.measuring.session import MeasuringSession
from rarms_iac.model.experiment import Experiment
from rarms_iac.model.host import ProviderKind
from rarms_iac.model.quantities import ReservePercent
from rarms_iac.model.setting import Setting, join_settings
from rarms_iac.model.system import Component
from rarms_iac.model.version import __version__
from rarms_iac.running.orders import CannotStart, StartContext
from rarms_iac.running.start import setup_digests
from rarms_iac.storage.datalog.files import append_setting, log_path, read_log
from rarms_iac.storage.datalog.identity import Changed, Present, header_of, identity_of, present_log
from rarms_iac.storage.datalog.log import DataLog, Header, Provenance, Recorded


@dataclass(frozen=True, slots=True, kw_only=True)
class ExperimentLog:
    """The records of an experiment as they were read; the first new setting begins the file, or adds a header."""

    path: Path
    experiment: Experiment
    header: Header  # as everything is now
    present: Present | None  # what holds of the file; None: no file

    @property
    def valid(self) -> DataLog | None:
        """The records that hold; None: there are none."""
        return None if self.present is None else self.present.log

    @property
    def changed(self) -> tuple[Changed, ...]:
        """What changed since it was measured, where nothing of it holds."""
        return () if self.present is None else self.present.comparison.changed

    @property
    def known(self) -> "KnownSettings":
        """The settings that count, with as many processors as the experiment has now."""
        return self._known(() if self.valid is None else self._of_processors(self.valid).counting)

    @property
    def seen(self) -> "KnownSettings":
        """The same, and the settings of the first pass."""
        return self._known(() if self.valid is None else self._of_processors(self.valid).estimating)

    def _of_processors(self, log: DataLog) -> DataLog:
        return log.of(self.header.setup.processors)

    def _known(self, records: Sequence[Recorded]) -> "KnownSettings":
        simulated = self.header.platform_facts.provider is ProviderKind.SIMULATED
        return KnownSettings(runs=tuple(record.setting for record in records), simulated=simulated)

    def add(self, setting: Setting, beside: tuple[str, ...]) -> None:
        """Record a setting, whole or not at all; it is on the disk when this returns.

        Args:
            beside: Names of other partitions that ran meanwhile.

        Raises:
            OSError: It cannot be written.
        """
        weak = is_weak(self.experiment.load, setting, self.experiment.host)
        taken = Provenance(rarms_version=__version__, when=now(), beside=beside, weak_load=weak)
        append_setting(self.path, self.header, Recorded(setting=setting, provenance=taken))


@dataclass(frozen=True, slots=True, kw_only=True)
class KnownSettings:
    """The measured settings, each run by itself, and joined to one setting a reservation."""

    runs: tuple[Setting, ...]
    simulated: bool
    joined: dict[int, Setting] = field(default_factory=dict)  # by reserve, what `at` worked out

    @property
    def settings(self) -> tuple[Setting, ...]:
        """One setting a reservation, in the order in which they were first measured."""
        return self.seen_with(None)

    def seen_with(self, seed: int | None) -> tuple[Setting, ...]:
        """Select the settings that were measured with this seed.

        Returns:
            Each with all that counts at its reservation, in the order in which they were first measured with the seed.
        """
        return tuple(map(self.at, dict.fromkeys(run.reserve for run in self.runs if seed is None or run.seed == seed)))

    def at(self, reserve: ReservePercent) -> Setting:
        """Join the runs of a reservation that was measured.

        NOTE: once, since estimates are kept with the samples that they are made of.
        """
        if reserve not in self.joined:
            self.joined[reserve] = self.joined_with(reserve)
        return self.joined[reserve]

    def joined_with(self, reserve: ReservePercent, *more: Setting) -> Setting:
        """Join the runs of a reservation with more.

        Args:
            more: runs that are not recorded yet.
        """
        runs = [run for run in self.runs if run.reserve == reserve]
        (joined,) = join_settings((*runs, *more), simulated=self.simulated)
        return joined

    def spent_ms(self, reserve: ReservePercent, seed: int) -> float:
        """Sum the host's time that was spent on a reservation before.

        Args:
            seed: of the run that follows: a simulated host goes through the time of the same seed again.

        Returns:
            Milliseconds.
        """
        runs = [run for run in self.runs if run.reserve == reserve and not (self.simulated and run.seed == seed)]
        return join_settings(runs, simulated=self.simulated)[0].host_ms if runs else 0.0

    def with_run(self, run: Setting) -> "KnownSettings":
        """Return these and one run more."""
        joined = {reserve: setting for reserve, setting in self.joined.items() if reserve != run.reserve}
        return replace(self, runs=(*self.runs, run), joined=joined)


def read_experiment_log(session: MeasuringSession, experiment: Experiment) -> ExperimentLog:
    """Read the data log of an experiment, and compare it with what is now.

    Args:
        session: It holds the experiment's host, which is asked for its processor, build and the like.

    Returns:
        The log with what changed since; empty without a file.

    Raises:
        UseCaseError: It is damaged (negative); it is not replaced unasked, as it may be all that there is.
    """
    path, header = data_log_path(session.hosts, experiment), _header(session, experiment)
    with log_errors():
        file = read_log(path)
    present = None if file is None else present_log(file, header.setup.members, header.identity, header.platform_facts)
    return ExperimentLog(path=path, experiment=experiment, header=header, present=present)


def data_log_path(hosts: Hosts, experiment: Experiment) -> Path:
    """Return the path of an experiment's data log.

    Args:
        experiment: its host's platform, its members and the interfering load name the file.

    Returns:
        A path that need not exist.
    """
    setup = experiment.setup
    return log_path(hosts.folder, experiment.host.platform, setup.members, setup.interference)


def _header(session: MeasuringSession, experiment: Experiment) -> Header:
    """Return the header of this experiment's data log under the present conditions."""
    system, setup = session.hosts.system, experiment.setup
    subject = subject_of(system, experiment.host, setup.members, setup.interference, experiment.load_parts)
    files = files_of(session.hosts.manifest, most_bytes=None)
    runs_here = experiment.host.connect is None and experiment.host.provider is ProviderKind.LINUX
    variables = _variables(subject.components, session.hosts.manifest.code_folder) if runs_here else {}
    interpreters = {**files.interpreters(subject), **variables} if runs_here else {}
    identity, subject = identity_of(subject, files.of(subject), interpreters), replace(subject, setup=setup)
    if files.cut:
        names = " and ".join(setup.members)
        session.control.reporter.message(f"{names}: {files.cut}. rarms does not notice changes in other files.")
    return header_of(subject, identity, session.host_of(experiment).platform_facts())


def _variables(components: Iterable[Component], base: Path) -> dict[str, str]:
    """Return digests of the variables that setup files change. Files that cannot be sourced start no component."""
    found: dict[str, str] = {}
    with suppress(CannotStart):
        for component in components:
            if component.run is not None:
                found |= setup_digests(component.name, component.run, StartContext(base=base.resolve()))
    return found
