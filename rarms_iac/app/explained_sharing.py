"""Sharing a partition: what its members would need apart, and which others might join them.

What `rarms tune` measured stands in its log; of what was never measured, the members' own curves allow a prediction.
"""

from collections.abc import Iterator, Mapping
from dataclasses import dataclass, field, replace
from fractions import Fraction

from rarms_iac.app.data_logs import Measurements, logs_of, measured_reservations
from rarms_iac.app.decision_logs import outdated_compounds
from rarms_iac.app.explained_partition import ExplainedPartition, ExplainedPlace
from rarms_iac.model.commands import command
from rarms_iac.model.host import Host
from rarms_iac.model.layout import Layout, PlacedPartition
from rarms_iac.model.output import output
from rarms_iac.model.quantities import LogicalProcessors
from rarms_iac.planner.combining.candidates import at_least
from rarms_iac.planner.groups import Group, groups_of, may_share
from rarms_iac.planner.layout import plan_layout
from rarms_iac.planner.prediction.members import Predict, alone_in, predictor_of
from rarms_iac.planner.reservations import MeasuredReservations, Names, names_of
from rarms_iac.planner.sizes import size
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
class Partner:
    """A partition with which sharing would save, as the members' own curves predict."""

    name: str
    together_lp: LogicalProcessors  # that both would reserve in one partition
    apart_lp: LogicalProcessors  # that they reserve in partitions of their own


@dataclass(frozen=True, slots=True, kw_only=True)
class OwnPartitions:
    """What the members of a partition would reserve in partitions of their own."""

    reserved_lp: Mapping[str, LogicalProcessors]  # by partition
    fits: bool

    @property
    @output
    def total_lp(self) -> LogicalProcessors:
        """All together."""
        return LogicalProcessors(sum(self.reserved_lp.values(), Fraction(0)))


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
        return PreviousTuning(runs=runs, outdated=outdated_compounds(runs, measurements, host))
    except LogUnreadable as problem:
        place = f"{path.relative_to(folder).as_posix()}, line {problem.line}"
        return PreviousTuning(unreadable=f"{place}: {problem.message}")


def own_partitions(partition: ExplainedPartition, place: ExplainedPlace) -> OwnPartitions | None:
    """Work out what the members would reserve in partitions of their own, and whether that fits.

    For this the layout is planned without the partition.

    Args:
        partition: with at least two members.
        place: where it is, or could be.

    Returns:
        None where it is not known, or where nothing would change.
    """
    group, measurements = partition.group, partition.measurements
    if group.name not in measurements.system.partitions or len(group.members) == 1:
        return None
    partitions = {name: request for name, request in measurements.system.partitions.items() if name != group.name}
    alone = replace(measurements, system=replace(measurements.system, partitions=partitions))
    reservations = measured_reservations(alone, partition.states)
    names = set(names_of(group.members))
    sizes = [
        size(part, place.host, reservations) for part in groups_of(alone.system) if names & set(names_of(part.members))
    ]
    parts = [answer for answer in sizes if isinstance(answer, PlacedPartition)]
    if len(parts) < len(sizes) or len(sizes) == 1:
        return None
    places = partition.hosts.manifest.places
    fits = isinstance(plan_layout(alone.system, reservations, partition.views, places).answer, Layout)
    return OwnPartitions(reserved_lp={part.name: part.reserved for part in parts}, fits=fits)


MOST_PARTNERS = 3


def partners(partition: ExplainedPartition, host: Host) -> tuple[Partner, ...]:
    """Find which pairs would save most, if what their members do alone is a guide.

    Args:
        partition: What is explained; its reservation rests on a data log.
        host: Where it is.

    Returns:
        The largest saving first; only pairs of which nothing was measured: of others the data log says more.
    """
    group, reservations, groups = partition.group, partition.reservations, groups_of(partition.system)
    others = [
        other
        for other in groups
        if other.name != group.name
        and may_share(group, other)
        and not _was_measured(partition.measurements, host, names_of((*group.members, *other.members)))
    ]
    predict = predictor_of(alone_in(groups, reservations, host))
    savings = [_saving(group, other, host, reservations, predict) for other in others]
    found = (saving for saving in savings if saving is not None)
    return tuple(sorted(found, key=lambda pair: (pair.together_lp - pair.apart_lp, pair.name))[:MOST_PARTNERS])


def _saving(
    group: Group, other: Group, host: Host, reservations: MeasuredReservations, predict: Predict
) -> Partner | None:
    """None: sharing saves nothing, or nothing says so."""
    sizes = [size(part, host, reservations) for part in (group, other)]
    claims = [answer.claim for answer in sizes if isinstance(answer, PlacedPartition)]
    if len(claims) < len(sizes):
        return None
    costs, processors = [claim.percent for claim in claims], max(claim.processors for claim in claims)
    predicted = predict(names_of((*group.members, *other.members)), processors)
    together = 0 if predicted is None else max(predicted, at_least(max(costs), processors))
    if not 0 < together * processors < sum(costs):
        return None
    together_lp, apart_lp = (
        LogicalProcessors(Fraction(percent, 100)) for percent in (together * processors, sum(costs))
    )
    return Partner(name=other.name, together_lp=together_lp, apart_lp=apart_lp)


def _was_measured(measurements: Measurements, host: Host, names: Names) -> bool:
    return all(path.is_file() for path in logs_of(measurements, host, names))
