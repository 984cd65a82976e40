"""Sharing a partition: who put its members together, what they would need apart, and who else might join them.

What `rarms tune` measured stands in its log; of what was never measured, the members' own curves allow a prediction.
"""

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace
from fractions import Fraction

from rarms_iac.app.data_logs import Measurements, logs_of, measured_reservations
from rarms_iac.app.decision_logs import outdated_compounds
from rarms_iac.app.explained_partition import ExplainedPartition, ExplainedPlace
from rarms_iac.model.commands import Wording, command, prose
from rarms_iac.model.host import Host
from rarms_iac.model.layout import Layout, PlacedPartition
from rarms_iac.model.quantities import show_lp_percent, show_processors
from rarms_iac.model.system import System
from rarms_iac.planner.combining.candidates import at_least
from rarms_iac.planner.groups import Group, groups_of, may_share
from rarms_iac.planner.layout import plan_layout
from rarms_iac.planner.prediction.members import Predict, alone_in, predictor_of
from rarms_iac.planner.reservations import MeasuredReservations, Names, names_of
from rarms_iac.planner.sizes import size
from rarms_iac.storage.datalog.decisions import TuningRun, read_runs, tuning_path
from rarms_iac.storage.datalog.files import LogUnreadable

STRATEGIES = {"default": "the default strategy", "paper": "the paper's procedure"}


NOT_LOOKED_FOR = "sharing with others: not looked for, as its reserve rests on no measurement"


@dataclass(frozen=True, slots=True, kw_only=True)
class PreviousTuning:
    """The runs of a platform, oldest first; or why they cannot be read."""

    runs: tuple[TuningRun, ...] = ()
    unreadable: str = ""
    outdated: Mapping[Names, str] = field(default_factory=dict)  # as of `PlatformTuning`

    def combined(self, members: Names) -> str:
        """Say how tuning put just these components together; empty: no run of it wrote that.

        Args:
            members: sorted names.

        Returns:
            A clause without a full stop, or nothing.
        """
        for run in reversed(self.runs):
            for partition in run.partitions:
                if run.written and partition.parts is not None and tuple(sorted(partition.components)) == members:
                    claim = f", {run.claim} to be the best" if run.strategy == "default" else ""
                    return (
                        f"`rarms tune` combined them at {run.when}, by {STRATEGIES[run.strategy]}{claim}: CR "
                        f"{show_lp_percent(partition.reserved)} ({partition.reserve} % of its VPs) instead of "
                        f"{show_lp_percent(partition.parts)} apart"
                    )
        return ""

    def rejected(self, members: Names) -> Iterator[str]:
        """Yield the compounds with any of these that tuning measured, except that of just these, as they were asked.

        What a later run saw at the same reservation counts.

        Args:
            members: sorted names.

        Yields:
            A clause for each compound, without a full stop.
        """
        answers_of: dict[Names, dict[int, tuple[str, ...]]] = {}
        for run in self.runs:
            for setting in run.trail:
                names = tuple(sorted(setting.components))
                if set(names) & set(members) and names != members:
                    answers_of.setdefault(names, {})[setting.reserve] = setting.worse
        for names, answers in answers_of.items():
            why = f"; outdated: {self.outdated[names]}" if names in self.outdated else ""
            yield f"{'+'.join(names)}, as `rarms tune` measured it: {'; '.join(_describe_answers(answers))}{why}"

    def nothing(self, platform: str) -> str:
        """Say why there is nothing to tell; empty: there are runs.

        Args:
            platform: whose log of tuning it is.

        Returns:
            A clause without a full stop, or nothing.
        """
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
        return PreviousTuning(runs=runs, outdated=outdated_compounds(runs, measurements, host))
    except LogUnreadable as problem:
        place = f"{path.relative_to(folder).as_posix()}, line {problem.line}"
        return PreviousTuning(unreadable=f"what `rarms tune` measured cannot be told: {place}: {problem.message}")


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


def _describe_answers(answers: Mapping[int, Sequence[str]]) -> Iterator[str]:
    """The lowest that was enough, and the highest that was not."""
    enough = min((reserve for reserve, worse in answers.items() if not worse), default=None)
    missed = max((reserve for reserve, worse in answers.items() if worse), default=None)
    if enough is not None:
        yield f"{enough} % of its VPs is enough, and another layout was taken"
    if missed is not None:
        yield f"{missed} % of its VPs is not enough for {' and '.join(answers[missed])} for sure"


def describe_own_partitions(partition: ExplainedPartition, place: ExplainedPlace) -> str:
    """Say what the members would reserve in partitions of their own, and whether that fits.

    For this the layout is planned without the partition.

    Args:
        partition: with at least two members.
        place: where it is, or could be.

    Returns:
        A clause; empty where it is not known, or where nothing would change.
    """
    group, measurements = partition.group, partition.measurements
    if group.name not in measurements.system.partitions or len(group.members) == 1:
        return ""
    partitions = {name: request for name, request in measurements.system.partitions.items() if name != group.name}
    alone = replace(measurements, system=replace(measurements.system, partitions=partitions))
    reservations = measured_reservations(alone, partition.states)
    names = set(names_of(group.members))
    sizes = [
        size(part, place.host, reservations) for part in groups_of(alone.system) if names & set(names_of(part.members))
    ]
    parts = [answer for answer in sizes if isinstance(answer, PlacedPartition)]
    if len(parts) < len(sizes) or len(sizes) == 1:
        return ""
    places = partition.hosts.manifest.places
    fits = isinstance(plan_layout(alone.system, reservations, partition.views, places).answer, Layout)
    list_of_parts = " and ".join(f"{part.name} {show_processors(part.reserved)}" for part in parts)
    total = show_processors(sum((part.reserved for part in parts), Fraction(0)))
    return (
        f"apart: {list_of_parts}, {total} instead of {show_processors(place.partition.reserved)}; "
        f"{'that fits too' if fits else 'that does not fit'}"
    )


MOST_PARTNERS = 3


def describe_partners(partition: ExplainedPartition, host: Host) -> tuple[Wording, ...]:
    """Say which pairs would save most, if what their members do alone is a guide.

    Args:
        partition: What is explained; its reservation rests on a data log.
        host: Where it is.

    Returns:
        Clauses, the largest saving first; only pairs of which nothing was measured: of others the data log says more.
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
    found = sorted((saving for saving in savings if saving is not None), key=lambda saving: (saving[0], str(saving[1])))
    return tuple(message for _, message in found[:MOST_PARTNERS])


def _saving(
    group: Group, other: Group, host: Host, reservations: MeasuredReservations, predict: Predict
) -> tuple[int, Wording] | None:
    """With what it saves, below 0, in per cent of one logical processor; None: nothing, or nothing says so."""
    sizes = [size(part, host, reservations) for part in (group, other)]
    claims = [answer.claim for answer in sizes if isinstance(answer, PlacedPartition)]
    if len(claims) < len(sizes):
        return None
    costs, processors = [claim.percent for claim in claims], max(claim.processors for claim in claims)
    predicted = predict(names_of((*group.members, *other.members)), processors)
    together = 0 if predicted is None else max(predicted, at_least(max(costs), processors))
    if not 0 < together * processors < sum(costs):
        return None
    separate, now = map(show_lp_percent, (sum(costs), together * processors))
    message = prose(
        f"sharing with {other.name}: predicted {now} instead of {separate} apart; ", command("tune"), " measures it"
    )
    return together * processors - sum(costs), message


def _was_measured(measurements: Measurements, host: Host, names: Names) -> bool:
    return all(path.is_file() for path in logs_of(measurements, host, names))
