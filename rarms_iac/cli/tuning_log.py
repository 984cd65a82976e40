"""What tuning asked for and found, written down beside the data logs, and read for reports."""

from collections.abc import Iterator
from pathlib import Path

from rarms_iac import __version__
from rarms_iac.app.errors import Outcome, UseCaseError
from rarms_iac.app.hosts import Hosts
from rarms_iac.app.report_model import PlatformTuning
from rarms_iac.app.tune import TuningResult
from rarms_iac.cli.books import unreadable
from rarms_iac.cli.configuration import now
from rarms_iac.cli.locks import held_configurations
from rarms_iac.model.system import System
from rarms_iac.storage.datalog.files import LogUnreadable
from rarms_iac.storage.datalog.tuning import TrailSetting, TuningRun, append_run, read_runs, tuning_path


def run_of(tuned: TuningResult) -> TuningRun | None:
    """The run as it is written down; None where it was stopped: it goes on, and is written when it ends."""
    if tuned.ending == "stopped":
        return None
    return TuningRun(
        when=now(),
        rarms_version=__version__,
        strategy=tuned.strategy,
        ending=tuned.ending,
        message=tuned.message,
        capacity=tuned.capacity,
        before=tuned.before,
        after=tuned.after,
        proved=tuned.proved,
        contradictions=tuned.contradictions,
        partitions=tuned.partitions,
        trail=tuple(
            TrailSetting(components=one.members, reserve=one.reserve, worse=one.worse, predicted=one.predicted)
            for one in tuned.trail
        ),
        written=bool(tuned.written),
        probability=tuned.probability,
    )


def record_tuning(hosts: Hosts, platform: str, run: TuningRun) -> None:
    """Write it into the platform's log of tuning; one that asked for nothing says nothing that the manifest does not.

    Raises:
        UseCaseError: the log is damaged (4), or another run does not let go of it (3).
        OSError: it cannot be written.
    """
    if not run.trail:
        return
    with held_configurations(Path(hosts.folder)):
        try:
            append_run(tuning_path(Path(hosts.folder), platform), run)
        except LogUnreadable as problem:
            raise UseCaseError(Outcome.NEGATIVE, [unreadable(problem)]) from None


def tunings_of(system: System, folder: Path) -> Iterator[PlatformTuning]:
    """The last run of every platform of the manifest that has one.

    Raises:
        UseCaseError: a log is damaged (4).
    """
    for platform in sorted({host.platform for host in system.hosts.values()}):
        try:
            runs = read_runs(tuning_path(folder, platform))
        except LogUnreadable as problem:
            raise UseCaseError(Outcome.NEGATIVE, [unreadable(problem)]) from None
        if runs:
            yield PlatformTuning(platform=platform, run=runs[-1])
