"""What tuning asked for and found, written down beside the data logs, and read for reports."""

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path

from rarms_iac.app.data_logs import Measurements, why_outdated
from rarms_iac.app.hosts import Hosts
from rarms_iac.app.measurement_files import hold_configuration_logs, log_errors
from rarms_iac.app.report_model import PlatformTuning
from rarms_iac.model.quantities import show_lp_percent
from rarms_iac.model.system import Host, System
from rarms_iac.planner.groups import Group
from rarms_iac.planner.reservations import Names, names_of
from rarms_iac.storage.datalog.files import LogUnreadable
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

    Raises:
        UseCaseError: A log is damaged (negative).
    """
    hosts = {host.platform: host for _, host in sorted(measurements.system.hosts.items(), reverse=True)}
    for platform, host in sorted(hosts.items()):
        with log_errors():
            runs = read_runs(tuning_path(measurements.folder, platform))
        if runs:
            outdated = _outdated_compounds(runs[-1:], measurements, host)
            yield PlatformTuning(platform=platform, run=runs[-1], outdated=outdated)


def _outdated_compounds(runs: Sequence[TuningRun], measurements: Measurements, host: Host) -> Mapping[Names, str]:
    """Why what was measured of compounds does not hold any more; those that hold are left out."""
    compounds = {tuple(sorted(setting.components)) for run in runs for setting in run.trail}
    found = {names: why_outdated(measurements, host, names) for names in sorted(compounds)}
    return {names: why for names, why in found.items() if why}


STRATEGIES = {"default": "the default strategy", "paper": "the paper's procedure"}


NOT_LOOKED_FOR = "sharing with others: not looked for, as its reserve rests on no measurement"


@dataclass(frozen=True, slots=True, kw_only=True)
class PreviousTuning:
    """The runs of a platform, oldest first; or why they cannot be read."""

    runs: tuple[TuningRun, ...] = ()
    unreadable: str = ""
    outdated: Mapping[Names, str] = field(default_factory=dict)  # as of `PlatformTuning`

    def combined(self, members: Names) -> str:
        """Say how tuning put just these components together; empty: no run of it wrote that."""
        for run in reversed(self.runs):
            for partition in run.partitions:
                if run.written and partition.parts is not None and tuple(sorted(partition.components)) == members:
                    claim = f", {run.claim} to be the best" if run.strategy == "default" else ""
                    return (
                        f"`rarms tune` combined them at {run.when}, by {STRATEGIES[run.strategy]}{claim}: CR "
                        f"{partition.reserve} %, {show_lp_percent(partition.reserved)} instead of "
                        f"{show_lp_percent(partition.parts)} apart"
                    )
        return ""

    def rejected(self, members: Names) -> Iterator[str]:
        """Yield the compounds with any of these that tuning measured, except that of just these, as they were asked.

        What a later run saw at the same reservation counts.
        """
        seen: dict[Names, dict[int, tuple[str, ...]]] = {}
        for run in self.runs:
            for setting in run.trail:
                names = tuple(sorted(setting.components))
                if set(names) & set(members) and names != members:
                    seen.setdefault(names, {})[setting.reserve] = setting.worse
        for names, settings in seen.items():
            why = f"; outdated: {self.outdated[names]}" if names in self.outdated else ""
            yield f"{'+'.join(names)}, as `rarms tune` measured it: {'; '.join(_settings(settings))}{why}"

    def nothing(self, platform: str) -> str:
        """Say why there is nothing to tell; empty: there are runs."""
        if self.unreadable:
            return self.unreadable
        return "" if self.runs else f"`rarms tune` has measured nothing on {platform}"


def previous_tuning(measurements: Measurements, host: Host) -> PreviousTuning:
    """Read the log of tuning of a host's platform.

    Args:
        measurements: those beside the manifest; what tuning measured is compared with them.
        host: of the manifest.

    Returns:
        The recorded runs; a log that cannot be read gives a message in `unreadable`, and no error.
    """
    folder = measurements.folder
    path = tuning_path(folder, host.platform)
    try:
        runs = read_runs(path)
        return PreviousTuning(runs=runs, outdated=_outdated_compounds(runs, measurements, host))
    except LogUnreadable as problem:
        shown = path.relative_to(folder).as_posix()
        return PreviousTuning(
            unreadable=f"what `rarms tune` measured cannot be told: {shown}, line {problem.line}: {problem.message}"
        )


def why_together(group: Group, system: System, previous: PreviousTuning) -> Iterator[str]:
    """Say what put the members of a partition together: the manifest, and who wrote that there.

    Args:
        group: the partition's members.
        system: the manifest.
        previous: the recorded runs of tuning.

    Yields:
        Clauses without a capital letter or a full stop; none for a component that the manifest leaves alone.
    """
    if group.name in system.partitions:
        by_tuning = previous.combined(names_of(group.members))
        by_hand = "no run of `rarms tune` that is on record here wrote it, so it was written by hand"
        yield f"the manifest's `partitions` puts them together ({group.name}); {by_tuning or by_hand}"
    for member in group.members:
        others = [name for name in member.together if name in names_of(group.members)]
        if others:
            yield f"{member.name} says that it must be together with {', '.join(others)}"


def rejected_compounds(group: Group, previous: PreviousTuning, host: Host) -> Iterator[str]:
    """Say which compounds with a partition's members were measured and not taken, or that there are none.

    Args:
        group: the partition's members.
        previous: the recorded runs of tuning.
        host: whose platform is named where nothing was tuned.

    Yields:
        At least one clause.
    """
    messages = list(previous.rejected(names_of(group.members)))
    yield from messages
    if not messages:
        why = previous.nothing(host.platform) or "`rarms tune` measured no other compound with it"
        yield f"sharing with others: {why}"


def _settings(settings: Mapping[int, Sequence[str]]) -> Iterator[str]:
    """The lowest that was enough, and the highest that was not."""
    enough = min((reserve for reserve, worse in settings.items() if not worse), default=None)
    missed = max((reserve for reserve, worse in settings.items() if worse), default=None)
    if enough is not None:
        yield f"{enough} % is enough, and another layout was taken"
    if missed is not None:
        yield f"{missed} % is not enough for {' and '.join(settings[missed])} for sure"
