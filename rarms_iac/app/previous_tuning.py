"""What earlier runs of `rarms tune` measured: which components they combined, and which compounds they rejected."""

from collections.abc import Iterator, Mapping
from dataclasses import dataclass, field

from rarms_iac.app.decision_logs import outdated_compounds
from rarms_iac.app.manifests import Manifest
from rarms_iac.model.commands import command
from rarms_iac.model.host import Host
from rarms_iac.planner.verdicts import Names
from rarms_iac.storage.datalog.decisions import TunedPartition, TuningRun, read_runs, tuning_path
from rarms_iac.storage.datalog.files import LogUnreadable

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

        Args:
            members: sorted names.

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

        Args:
            members: sorted names.
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
    """Read the log of tuning of a host's platform.

    Args:
        manifest: The manifest, with its measurements beside it; what tuning measured is compared with them.

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
