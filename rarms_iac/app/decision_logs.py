"""The logs of decisions, next to the data logs: what was chosen for each CoI, and what runs of tuning measured.

A configuration log is written whenever a choice is not what it says already; the tuning log has each run, and its
last ones are read for reports and explanations.
"""

from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path

from rarms_iac.app.data_logs import measured_reservations, why_outdated
from rarms_iac.app.hosts import Hosts
from rarms_iac.app.manifests import Manifest
from rarms_iac.app.measurement_files import hold_configuration_logs, log_errors, now
from rarms_iac.app.report_model import PlatformTuning
from rarms_iac.model.commands import command
from rarms_iac.model.host import Host
from rarms_iac.model.indexes import find_index
from rarms_iac.model.layout import PlacedPartition
from rarms_iac.model.system import Component
from rarms_iac.model.version import __version__
from rarms_iac.planner.groups import Group, groups_of
from rarms_iac.planner.reservations import depends_on_a_log, names_of, provisional_on
from rarms_iac.planner.sizes import size
from rarms_iac.planner.verdicts import MeasuredTogether, Names
from rarms_iac.storage.datalog.decisions import (
    Chosen,
    TunedPartition,
    TuningRun,
    append_run,
    last_chosen,
    read_entries,
    read_runs,
    tuning_path,
)
from rarms_iac.storage.datalog.files import LogUnreadable, append_to_log, configuration_path
from rarms_iac.texts.indexes import show_threshold


def record_choices(manifest: Manifest, components: Iterable[str] = ()) -> tuple[Path, ...]:
    """Write down what follows from the manifest and the data logs, where the configuration log does not say it yet.

    A component whose reservation is not known is left out: `rarms plan` gives the reason.

    Args:
        manifest: The manifest, with its measurements next to it.

    Returns:
        The configuration logs that were added to.

    Raises:
        UseCaseError: A configuration log is damaged (negative), or held by another run (refused).
        OSError: One cannot be written.
    """
    with hold_configuration_logs(manifest.folder):
        return _choices(manifest, components)


def _choices(manifest: Manifest, components: Iterable[str]) -> tuple[Path, ...]:
    system, names = manifest.system, set(components)
    reservations = measured_reservations(manifest, {})
    paths: list[Path] = []
    for group in filter(depends_on_a_log, groups_of(system)):
        if names and names.isdisjoint(names_of(group.members)):
            continue
        platforms: dict[str, Host] = {}
        for _, host in sorted(system.hosts.items()):
            if group.may_run_on(host.name):
                platforms.setdefault(host.platform, host)
        for host in platforms.values():
            if provisional_on(system, reservations, host, {group.name}):
                continue  # it is not chosen yet: the later passes decide
            sized = size(group, host, reservations)
            log = reservations.log(group.members, host)
            if isinstance(sized, PlacedPartition) and isinstance(log, MeasuredTogether) and log.least is not None:
                entries = _entries(group, log, sized.settings.reserve)
                paths += [path for entry in entries if (path := _record(manifest.folder, host.platform, entry))]
    return tuple(paths)


def describe_apt(component: Component) -> dict[str, str]:
    """Describe the thresholds of a component in words.

    Args:
        component: its APTs may name indexes that this version does not know; these are left out.

    Returns:
        By index: `at most 100 ms`.
    """
    return {
        name: show_threshold(index, threshold)
        for name, threshold in component.apt.items()
        if (index := find_index(name)) is not None
    }


def _entries(group: Group, measured: MeasuredTogether, reserve: int) -> tuple[Chosen, ...]:
    """Return the choice for each member, with the data log that asks for it."""
    header = measured.records.header
    return tuple(
        Chosen(
            component=member.name,
            when=now("microseconds"),
            rarms_version=__version__,
            apt=describe_apt(member),
            partition=group.name,
            reserve=reserve,
            task=member.task_class,
            data_log=measured.path,
            identity=header.digest,
            setup=replace(header.setup, processors=measured.processors),
            platform_facts=header.platform_facts,
        )
        for member in group.members
        if member.apt
    )


def _record(folder: Path, platform: str, chosen: Chosen) -> Path | None:
    path = configuration_path(folder, platform, chosen.component)
    with log_errors():
        last = last_chosen(read_entries(path))
    same = last is not None and replace(last, when=chosen.when, rarms_version=chosen.rarms_version) == chosen
    if same:
        return None
    append_to_log(path, chosen)
    return path


def record_tuning(hosts: Hosts, platform: str, run: TuningRun) -> None:
    """Write a run into the platform's tuning log; a run that was stopped, or asked for nothing, is left out.

    Args:
        hosts: Those of the manifest, below whose folder the log lies.

    Raises:
        UseCaseError: The log is damaged (negative), or another run does not let go of it (refused).
        OSError: It cannot be written.
    """
    if run.ending == "stopped" or not run.trail:
        return
    with hold_configuration_logs(hosts.folder), log_errors():
        append_run(tuning_path(hosts.folder, platform), run)


def tunings_of(manifest: Manifest) -> Iterator[PlatformTuning]:
    """Yield the last run of every platform of the manifest that has one, platforms by name.

    Args:
        manifest: The manifest, with its measurements next to it.

    Yields:
        A run a platform, with what does not hold any more.

    Raises:
        UseCaseError: A log is damaged (negative).
    """
    hosts = {host.platform: host for _, host in sorted(manifest.system.hosts.items(), reverse=True)}
    for platform, host in sorted(hosts.items()):
        with log_errors():
            runs = read_runs(tuning_path(manifest.folder, platform))
        if runs:
            outdated = outdated_compounds(runs[-1:], manifest, host)
            yield PlatformTuning(platform=platform, run=runs[-1], outdated=outdated)


def outdated_compounds(runs: Sequence[TuningRun], manifest: Manifest, host: Host) -> Mapping[Names, str]:
    """Say why what was measured of compounds does not hold any more.

    Args:
        runs: Those whose compounds are meant.
        manifest: The manifest, with its measurements next to it.

    Returns:
        By the sorted names of its members, a clause for each compound that is outdated.
    """
    compounds = {tuple(sorted(setting.components)) for run in runs for setting in run.trail}
    reasons = {names: why_outdated(manifest, host, names) for names in sorted(compounds)}
    return {names: why for names, why in reasons.items() if why}


TUNE = command("tune")


@dataclass(frozen=True, slots=True, kw_only=True)
class RejectedCompound:
    """A compound that `rarms tune` measured and that the layout does not have."""

    components: Names  # sorted
    enough: int | None  # the lowest CR that was enough; None: none was
    missed: int | None  # the highest that was not; None: all were enough
    worse: tuple[str, ...]  # the components that it was not enough for
    outdated: str  # why that does not hold any more; empty: it does


@dataclass(frozen=True, slots=True, kw_only=True)
class PreviousTuning:
    """The runs of a platform, oldest first; or why they cannot be read."""

    runs: tuple[TuningRun, ...] = ()
    unreadable: str = ""  # the file, the line, and what is wrong with it
    outdated: Mapping[Names, str] = field(default_factory=dict)  # as of `PlatformTuning`

    def combined(self, members: Names) -> tuple[TuningRun, TunedPartition] | None:
        """Return the last run that put just these components together, and the partition as it left that.

        Returns:
            None where no run wrote that into the manifest.
        """
        written = ((run, partition) for run in reversed(self.runs) if run.written for partition in run.partitions)
        return next(
            (
                (run, partition)
                for run, partition in written
                if partition.parts is not None and tuple(sorted(partition.components)) == members
            ),
            None,
        )

    def rejected(self, members: Names) -> Iterator[RejectedCompound]:
        """Yield the compounds with any of these that tuning measured, except that of just these, as they were asked.

        What a later run saw at the same reservation counts.
        """
        answers_of: dict[Names, dict[int, tuple[str, ...]]] = {}
        for run in self.runs:
            for setting in run.trail:
                names = tuple(sorted(setting.components))
                if set(names) & set(members) and names != members:
                    answers_of.setdefault(names, {})[setting.reserve] = setting.worse
        for names, answers in answers_of.items():
            missed = max((reserve for reserve, worse in answers.items() if worse), default=None)
            yield RejectedCompound(
                components=names,
                enough=min((reserve for reserve, worse in answers.items() if not worse), default=None),
                missed=missed,
                worse=() if missed is None else answers[missed],
                outdated=self.outdated.get(names, ""),
            )


def previous_tuning(manifest: Manifest, host: Host) -> PreviousTuning:
    """Read the tuning log of a host's platform.

    Args:
        manifest: The manifest, with its measurements next to it; what tuning measured is compared with them.

    Returns:
        The recorded runs; a log that cannot be read gives a message in `unreadable`, and no error.
    """
    folder = manifest.folder
    path = tuning_path(folder, host.platform)
    try:
        runs = read_runs(path)
        return PreviousTuning(runs=runs, outdated=outdated_compounds(runs, manifest, host))
    except LogUnreadable as problem:
        place = f"{path.relative_to(folder).as_posix()}, line {problem.line}"
        return PreviousTuning(unreadable=f"{place}: {problem.message}")
