"""The log of tuning beside the data logs: records each run, and reads the last ones for reports."""

from collections.abc import Iterator, Mapping, Sequence
from pathlib import Path

from rarms_iac.app.data_logs import Measurements, why_outdated
from rarms_iac.app.hosts import Hosts
from rarms_iac.app.measurement_files import hold_configuration_logs, log_errors
from rarms_iac.app.report_model import PlatformTuning
from rarms_iac.model.host import Host
from rarms_iac.planner.reservations import Names
from rarms_iac.storage.datalog.tuning import TuningRun, append_run, read_runs, tuning_path


def record_tuning(hosts: Hosts, platform: str, run: TuningRun) -> None:
    """Write a run into the platform's log of tuning; a run that was stopped, or asked for nothing, is left out.

    Args:
        hosts: Those of the manifest, below whose folder the log lies.
        platform: Of the host that was measured on.
        run: As it ended.

    Raises:
        UseCaseError: The log is damaged (negative), or another run does not let go of it (refused).
        OSError: It cannot be written.
    """
    if run.ending == "stopped" or not run.trail:
        return
    with hold_configuration_logs(Path(hosts.folder)), log_errors():
        append_run(tuning_path(Path(hosts.folder), platform), run)


def tunings_of(measurements: Measurements) -> Iterator[PlatformTuning]:
    """Yield the last run of every platform of the manifest that has one, platforms by name.

    Args:
        measurements: those beside the manifest.

    Yields:
        A run a platform, with what does not hold any more.

    Raises:
        UseCaseError: A log is damaged (negative).
    """
    hosts = {host.platform: host for _, host in sorted(measurements.system.hosts.items(), reverse=True)}
    for platform, host in sorted(hosts.items()):
        with log_errors():
            runs = read_runs(tuning_path(measurements.folder, platform))
        if runs:
            outdated = outdated_compounds(runs[-1:], measurements, host)
            yield PlatformTuning(platform=platform, run=runs[-1], outdated=outdated)


def outdated_compounds(runs: Sequence[TuningRun], measurements: Measurements, host: Host) -> Mapping[Names, str]:
    """Say why what was measured of compounds does not hold any more.

    Args:
        runs: Those whose compounds are meant.
        measurements: Those beside the manifest.
        host: On which the compounds were to be.

    Returns:
        By the sorted names of its members, a clause for each compound that is outdated.
    """
    compounds = {tuple(sorted(setting.components)) for run in runs for setting in run.trail}
    reasons = {names: why_outdated(measurements, host, names) for names in sorted(compounds)}
    return {names: why for names, why in reasons.items() if why}
