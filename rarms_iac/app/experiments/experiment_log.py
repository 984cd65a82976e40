"""The data log of an experiment for who measures: where it lies, whether it still holds, and measuring it once more.

With `--again` each log says which remeasurement is not ended, so that the same command goes on with it after a kill.
"""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from datetime import UTC, datetime
from pathlib import Path

from rarms_iac.app.data_logs import subject_of
from rarms_iac.app.experiments.measure_request import MeasureRequest
from rarms_iac.app.hosts import Hosts
from rarms_iac.app.measurement_files import hold_data_log, log_errors, now
from rarms_iac.measuring.loop import SettingsLog
from rarms_iac.measuring.partitions import partition_name
from rarms_iac.measuring.setup import Experiment
from rarms_iac.model.host import Host, ProviderKind
from rarms_iac.model.state import Partition
from rarms_iac.model.version import __version__
from rarms_iac.providers.measuring import MeasuringHost
from rarms_iac.storage.datalog.files import append_remeasurement, begin_log, log_path, read_log
from rarms_iac.storage.datalog.identity import Files, header_of, identity_of
from rarms_iac.storage.datalog.log import DataLog, Header, Provenance, Remeasurement
from rarms_iac.storage.datalog.staleness import Changed, compare, known


@dataclass(frozen=True, slots=True, kw_only=True)
class ExperimentLog:
    """What is recorded of an experiment, beside what it would be recorded under now."""

    path: Path
    header: Header  # as everything is now
    log: DataLog | None
    changed: tuple[Changed, ...]  # since it was begun: it is stale, if there are any

    @property
    def valid(self) -> DataLog | None:
        """The log, if there is one that is not stale."""
        return None if self.changed else self.log


def read_experiment_log(hosts: Hosts, experiment: Experiment, bench: MeasuringHost) -> ExperimentLog:
    """Read the data log of an experiment, and compare it with what is now.

    Args:
        hosts: The manifest's hosts.
        experiment: What is measured, and on which host.
        bench: That host; asked for its processor, build and the like.

    Returns:
        The log with what changed since; empty where there is no file.

    Raises:
        UseCaseError: It is damaged (negative); nobody replaces it unasked, as it may be all that there is.
    """
    path, header = data_log_path(hosts, experiment), _header(hosts, experiment, bench)
    with log_errors():
        log = read_log(path)
    changed = () if log is None else compare(log.header, header.identity, known(header.bench)).changed
    return ExperimentLog(path=path, header=header, log=log, changed=changed)


def settings_log_of(log: ExperimentLog, seed: int | None, running: Sequence[Partition]) -> SettingsLog:
    """Return the log as the loop of measuring writes to it; a stale log gives way to the first setting.

    Args:
        log: What is recorded.
        seed: Only its settings count; None: all.
        running: What runs on the host beside P1 and P2; every setting says so.

    Returns:
        A log to read the settings of and to add to.
    """
    beside = tuple(partition_name(partition) for partition in running)
    return SettingsLog(
        path=log.path,
        header=log.header,
        provenance=lambda: Provenance(rarms_version=__version__, when=now(), beside=beside),
        seed=seed,
        replaces_stale=bool(log.changed),
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
    return log_path(Path(hosts.folder), experiment.host.platform, setup.members, setup.interference)


def _header(hosts: Hosts, experiment: Experiment, bench: MeasuringHost) -> Header:
    """What the data log of this experiment begins with, as everything is now."""
    subject = subject_of(hosts.system, experiment.host, experiment.setup.members, experiment.setup.interference)
    files = Files(Path(hosts.folder))
    interpreters = files.interpreters(subject) if _runs_here(experiment.host) else {}
    return header_of(subject, identity_of(subject, files.of(subject), interpreters), bench.bench())


def remeasurements_for(
    hosts: Hosts,
    experiments: Sequence[Experiment],
    benches: Mapping[str, MeasuringHost],
    request: MeasureRequest,
    refuse: Callable[[Experiment], None],
) -> Mapping[Path, Remeasurement]:
    """Find or begin the remeasurement of each experiment.

    A command that was killed goes on: its other logs say whether they had their turn.

    Args:
        hosts: The manifest's hosts.
        experiments: What is to be measured once more.
        benches: The hosts that they are measured on, by name.
        request: What was asked for; tells this command's remeasurements from those of others.
        refuse: Raises where an experiment cannot be run; nothing is written then.

    Returns:
        By data log the remeasurement that is not ended, or a new one, which all logs say then.

    Raises:
        UseCaseError: A log is damaged (negative), or held by another run (refused).
    """
    logs = [read_experiment_log(hosts, experiment, benches[experiment.host.name]) for experiment in experiments]
    asked = describe_request(request)
    unfinished = [last for log in logs if (last := _last(log, asked)) is not None and not last.ended]
    begun = max((remeasurement.begun for remeasurement in unfinished), default=None)
    known = {log.path: _of_that_command(log, asked, begun) for log in logs}
    for experiment, log in zip(experiments, logs, strict=True):
        if known[log.path] is None:
            refuse(experiment)
    started = begun or datetime.now(UTC).isoformat(timespec="microseconds")
    return {log.path: known[log.path] or _begin(hosts, log, asked, started, request) for log in logs}


def end_remeasurements(hosts: Hosts, complete: Mapping[Path, Remeasurement], request: MeasureRequest) -> None:
    """Record in each data log that all of its remeasurement is measured.

    Args:
        hosts: Those of the manifest.
        complete: The remeasurements, by data log.
        request: Says how long to wait for a log that is held.

    Raises:
        UseCaseError: A log is held by another run (refused).
    """
    for path, remeasurement in complete.items():
        if not remeasurement.ended:
            with hold_data_log(Path(hosts.folder), path, request.lock_timeout_ms):
                append_remeasurement(path, replace(remeasurement, ended=True))


def describe_request(request: MeasureRequest) -> str:
    """Describe what tells a command from others of the same components.

    Args:
        request: what was asked for.

    Returns:
        Words such as `default; 200 samples`; equal requests have equal words.
    """
    words: str = request.strategy
    if request.reserves:
        words = ", ".join(f"{reserve} %" for reserve in request.reserves)
    elif request.verify:
        words = "verify"
    return words if request.samples is None else f"{words}; {request.samples} samples"


def _last(log: ExperimentLog, asked: str) -> Remeasurement | None:
    remeasurements = () if log.valid is None else log.valid.remeasurements
    return next((each for each in reversed(remeasurements) if each.asked == asked), None)


def _of_that_command(log: ExperimentLog, asked: str, begun: str | None) -> Remeasurement | None:
    """The remeasurement of a command that began then; one that is not ended is gone on with in any case."""
    last = _last(log, asked)
    if begun is None or last is None or (last.ended and last.begun != begun):
        return None
    return last


def _begin(hosts: Hosts, log: ExperimentLog, asked: str, begun: str, request: MeasureRequest) -> Remeasurement:
    begins = Remeasurement(seed=1 if log.valid is None else log.valid.highest_seed + 1, asked=asked, begun=begun)
    with hold_data_log(Path(hosts.folder), log.path, request.lock_timeout_ms):
        if log.valid is None:
            begin_log(log.path, log.header)
        append_remeasurement(log.path, begins)
    return begins


def _runs_here(host: Host) -> bool:
    """Whether programs of this computer run on the host."""
    return host.connect is None and host.provider is ProviderKind.LINUX
