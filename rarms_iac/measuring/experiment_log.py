"""The data log of an experiment for who measures: where it lies, whether it still holds, and measuring it once more.

With `--again` each log says which remeasurement is not ended, so that the same command goes on with it after a kill.
"""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from datetime import UTC, datetime
from pathlib import Path

from rarms_iac.app.data_logs import files_of, subject_of
from rarms_iac.app.hosts import Hosts
from rarms_iac.app.measurement_files import hold_data_log, log_errors, now
from rarms_iac.measuring.evidence import is_weak
from rarms_iac.measuring.session import MeasuringSession
from rarms_iac.measuring.settings_log import SettingsLog
from rarms_iac.model.experiment import Experiment
from rarms_iac.model.host import ProviderKind
from rarms_iac.model.state import Partition
from rarms_iac.model.version import __version__
from rarms_iac.storage.datalog.files import append_remeasurement, end_remeasurement, log_path, read_log
from rarms_iac.storage.datalog.identity import header_of, identity_of
from rarms_iac.storage.datalog.log import DataLog, Header, Provenance, Remeasurement
from rarms_iac.storage.datalog.staleness import Changed, Present, present_log


@dataclass(frozen=True, slots=True, kw_only=True)
class ExperimentLog:
    """The records of an experiment, and the header that a setting would have now."""

    path: Path
    header: Header  # as everything is now
    present: Present | None  # what holds of the file; None: there is no file

    @property
    def valid(self) -> DataLog | None:
        """The records that hold; None: there are none."""
        return None if self.present is None else self.present.log

    @property
    def changed(self) -> tuple[Changed, ...]:
        """What changed since it was measured, where nothing of it holds."""
        return () if self.present is None else self.present.comparison.changed


def read_experiment_log(session: MeasuringSession, experiment: Experiment) -> ExperimentLog:
    """Read the data log of an experiment, and compare it with what is now.

    Args:
        session: It holds the experiment's host, which is asked for its processor, build and the like.
        experiment: What is measured.

    Returns:
        The log with what changed since; empty where there is no file.

    Raises:
        UseCaseError: It is damaged (negative); it is not replaced unasked, as it may be all that there is.
    """
    path, header = data_log_path(session.hosts, experiment), _header(session, experiment)
    with log_errors():
        file = read_log(path)
    present = None if file is None else present_log(file, header.setup.members, header.identity, header.platform_facts)
    return ExperimentLog(path=path, header=header, present=present)


def settings_log_of(
    log: ExperimentLog, experiment: Experiment, remeasure_seed: int | None, running: Sequence[Partition]
) -> SettingsLog:
    """Return the log as the loop of measuring writes to it.

    Args:
        log: What is recorded.
        experiment: What it is of.
        remeasure_seed: All of it is measured with this seed; None: what is there is not measured again.
        running: What runs on the host beside P1 and P2; every setting says so.

    Returns:
        A log to read the settings of and to add to.
    """
    others = tuple(partition.shown_name for partition in running)
    return SettingsLog(
        path=log.path,
        header=log.header,
        provenance=lambda setting: Provenance(
            rarms_version=__version__,
            when=now(),
            beside=others,
            weak_load=is_weak(experiment.load, setting, experiment.host),
        ),
        remeasure_seed=remeasure_seed,
    )


def data_log_path(hosts: Hosts, experiment: Experiment) -> Path:
    """Return where the data log of an experiment lies.

    Args:
        hosts: the manifest, whose folder has the logs.
        experiment: its host's platform, its members and the interfering load name the file.

    Returns:
        A path that need not exist.
    """
    setup = experiment.setup
    return log_path(hosts.folder, experiment.host.platform, setup.members, setup.interference)


def _header(session: MeasuringSession, experiment: Experiment) -> Header:
    """What the data log of this experiment begins with, as everything is now."""
    system, setup = session.hosts.system, experiment.setup
    subject = subject_of(system, experiment.host, setup.members, setup.interference)
    files = files_of(session.hosts.manifest, most_bytes=None)
    runs_here = experiment.host.connect is None and experiment.host.provider is ProviderKind.LINUX
    interpreters = files.interpreters(subject) if runs_here else {}
    identity, subject = identity_of(subject, files.of(subject), interpreters), replace(subject, setup=setup)
    if files.cut:
        names = " and ".join(setup.members)
        session.control.reporter.message(f"{names}: {files.cut}. A change of what is left out makes no log stale.")
    return header_of(subject, identity, session.host_of(experiment).platform_facts())


def remeasurements_for(
    session: MeasuringSession, experiments: Sequence[Experiment], asked: str, refuse: Callable[[Experiment], None]
) -> Mapping[Path, Remeasurement]:
    """Find or begin the remeasurement of each experiment.

    A command that was killed goes on: its other logs say whether they had their turn.

    Args:
        session: It holds the experiments' hosts.
        experiments: What is to be measured once more.
        asked: Tells this command's remeasurements from those of others (`measure_request.describe_request`).
        refuse: Raises where an experiment cannot be run; nothing is written then.

    Returns:
        By data log the remeasurement that is not ended, or a new one, which all logs say then.

    Raises:
        UseCaseError: A log is damaged (negative), or held by another run (refused).
    """
    logs = [read_experiment_log(session, experiment) for experiment in experiments]
    unfinished = [last for log in logs if (last := _last(log, asked)) is not None and not last.ended]
    begun = max((remeasurement.begun for remeasurement in unfinished), default=None)
    known = {log.path: _of_that_command(log, asked, begun) for log in logs}
    for experiment, log in zip(experiments, logs, strict=True):
        if known[log.path] is None:
            refuse(experiment)
    started = begun or datetime.now(UTC).isoformat(timespec="microseconds")
    return {log.path: known[log.path] or _begin(session, log, asked, started) for log in logs}


def end_remeasurements(session: MeasuringSession, complete: Mapping[Path, Remeasurement]) -> None:
    """Record in each data log that all of its remeasurement is measured.

    Args:
        session: Of the command that measured it; its hosts need not be held any more.
        complete: The remeasurements, by data log.

    Raises:
        UseCaseError: A log is held by another run (refused).
    """
    for path, remeasurement in complete.items():
        if not remeasurement.ended:
            with hold_data_log(session.hosts.folder, path, session.lock_timeout_ms):
                end_remeasurement(path, remeasurement)


def _last(log: ExperimentLog, asked: str) -> Remeasurement | None:
    remeasurements = () if log.valid is None else log.valid.remeasurements
    return next((each for each in reversed(remeasurements) if each.asked == asked), None)


def _of_that_command(log: ExperimentLog, asked: str, begun: str | None) -> Remeasurement | None:
    """The remeasurement of a command that began then; one that is not ended is gone on with in any case."""
    last = _last(log, asked)
    if begun is None or last is None or (last.ended and last.begun != begun):
        return None
    return last


def _begin(session: MeasuringSession, log: ExperimentLog, asked: str, begun: str) -> Remeasurement:
    begins = Remeasurement(seed=1 if log.valid is None else log.valid.highest_seed + 1, asked=asked, begun=begun)
    with hold_data_log(session.hosts.folder, log.path, session.lock_timeout_ms):
        append_remeasurement(log.path, log.header, begins)
    return begins
