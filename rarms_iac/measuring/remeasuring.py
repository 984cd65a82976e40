"""Measuring once more with `--again`: each log says which remeasurement is not ended.

So the same command goes on with it after a kill.
"""

from collections.abc import Mapping, Sequence
from datetime import UTC, datetime
from pathlib import Path

from rarms_iac.app.measurement_files import hold_data_log
from rarms_iac.measuring.experiment_log import ExperimentLog, read_experiment_log
from rarms_iac.measuring.run_experiment import stop_what_is_in_the_way
from rarms_iac.measuring.session import MeasuringSession
from rarms_iac.measuring.strategies import Method
from rarms_iac.model.experiment import Experiment
from rarms_iac.storage.datalog.files import append_remeasurement, end_remeasurement
from rarms_iac.storage.datalog.log import Remeasurement


def remeasurements_for(
    session: MeasuringSession, experiments: Sequence[Experiment], asked: str, method: Method
) -> Mapping[Path, Remeasurement]:
    """Find or begin the remeasurement of each experiment.

    A command that was killed goes on: its other logs say whether they had their turn.

    Args:
        experiments: What is to be measured once more.
        asked: Tells this command's remeasurements from those of others (`measure_request.describe_request`).

    Returns:
        By data log the remeasurement that is not ended, or a new one, which all logs say then.

    Raises:
        UseCaseError: A log is damaged (negative), or held by another run (refused); or as of
            `stop_what_is_in_the_way`. Nothing is written then.
    """
    logs = [read_experiment_log(session, experiment) for experiment in experiments]
    unfinished = [last for log in logs if (last := _last(log, asked)) is not None and not last.ended]
    begun = max((remeasurement.begun for remeasurement in unfinished), default=None)
    known = {log.path: _of_that_command(log, asked, begun) for log in logs}
    for experiment, log in zip(experiments, logs, strict=True):
        if known[log.path] is None:
            stop_what_is_in_the_way(session, experiment, method)
    started = begun or datetime.now(UTC).isoformat(timespec="microseconds")
    return {log.path: known[log.path] or _begin(session, log, asked, started) for log in logs}


def end_remeasurements(session: MeasuringSession, complete: Mapping[Path, Remeasurement]) -> None:
    """Record in each data log that all of its remeasurement is measured.

    Args:
        session: Of the command that measured it; its hosts need not be held any more.

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
    """Return the remeasurement of a command that began then; one that is not ended is gone on with in any case."""
    last = _last(log, asked)
    if begun is None or last is None or (last.ended and last.begun != begun):
        return None
    return last


def _begin(session: MeasuringSession, log: ExperimentLog, asked: str, begun: str) -> Remeasurement:
    begins = Remeasurement(seed=1 if log.valid is None else log.valid.highest_seed + 1, asked=asked, begun=begun)
    with hold_data_log(session.hosts.folder, log.path, session.lock_timeout_ms):
        append_remeasurement(log.path, log.header, begins)
    return begins
