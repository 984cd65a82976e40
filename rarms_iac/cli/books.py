"""The data log of an experiment, held by one who measures: where it lies, and whether it still holds."""

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

from rarms_iac import __version__
from rarms_iac.app.errors import Outcome, UseCaseError
from rarms_iac.app.hosts import Hosts
from rarms_iac.cli.configuration import now
from rarms_iac.cli.datalogs import is_here, subject_of
from rarms_iac.measuring.loop import SettingsLog
from rarms_iac.measuring.partitions import partition_name
from rarms_iac.measuring.setup import Experiment
from rarms_iac.model.diagnostics import Diagnostic
from rarms_iac.model.state import Partition
from rarms_iac.planner.findings import UNREADABLE
from rarms_iac.providers.measuring import MeasuringHost
from rarms_iac.storage.datalog.files import LogUnreadable, log_path, read_log
from rarms_iac.storage.datalog.identity import Files, header_of, identity_of
from rarms_iac.storage.datalog.log import DataLog, Header, Provenance
from rarms_iac.storage.datalog.staleness import Changed, compare, known


@dataclass(frozen=True, slots=True, kw_only=True)
class Kept:
    """What is recorded of an experiment, beside what it would be recorded under now."""

    path: Path
    header: Header  # as everything is now
    log: DataLog | None
    changed: tuple[Changed, ...]  # since it was begun: it is stale, if there are any

    @property
    def holds(self) -> DataLog | None:
        """The log, if there is one that holds."""
        return None if self.changed else self.log


def kept(hosts: Hosts, experiment: Experiment, bench: MeasuringHost) -> Kept:
    """The data log of this experiment, and what has changed since that was begun.

    Raises:
        UseCaseError: it is damaged (4): it may be all that there is of a measurement, so nobody replaces it unasked.
    """
    path, header = path_for(hosts, experiment), header_for(hosts, experiment, bench)
    try:
        log = read_log(path)
    except LogUnreadable as problem:
        raise UseCaseError(Outcome.NEGATIVE, [unreadable(problem)]) from None
    changed = () if log is None else compare(log.header, header.identity, known(header.bench)).changed
    return Kept(path=path, header=header, log=log, changed=changed)


def book_of(recorded: Kept, seed: int | None, running: Sequence[Partition]) -> SettingsLog:
    """The same for the loop of measuring; a stale log gives way to the first setting.

    Args:
        recorded: the log.
        seed: only its settings count; None: all.
        running: what runs on the host beside P1 and P2.
    """
    beside = tuple(partition_name(partition) for partition in running)
    return SettingsLog(
        path=recorded.path,
        header=recorded.header,
        provenance=lambda: Provenance(rarms_version=__version__, when=now(), beside=beside),
        seed=seed,
        anew=bool(recorded.changed),
    )


def path_for(hosts: Hosts, experiment: Experiment) -> Path:
    """Where its data log lies."""
    setup = experiment.setup
    return log_path(Path(hosts.folder), experiment.host.platform, setup.members, setup.interference)


def header_for(hosts: Hosts, experiment: Experiment, bench: MeasuringHost) -> Header:
    """What the data log of this experiment begins with, as everything is now."""
    subject = subject_of(hosts.system, experiment.host, experiment.setup.members, experiment.setup.interference)
    files = Files(Path(hosts.folder))
    interpreters = files.interpreters(subject) if is_here(experiment.host) else {}
    return header_of(subject, identity_of(subject, files.of(subject), interpreters), bench.bench())


def unreadable(problem: LogUnreadable) -> Diagnostic:
    """A log that is not as it was written."""
    return UNREADABLE.at(
        None,
        f"{problem.path.as_posix()}, line {problem.line}: {problem.says}.",
        "Bring it back from git, or remove it: then all of it is measured again.",
    )
