"""`rarms tune`: a line for each compound that is found, and the partitions that it leaves."""

from collections.abc import Callable, Mapping, Sequence
from typing import TYPE_CHECKING

from rarms_iac.app.report_model import PlatformTuning
from rarms_iac.measuring.tune import TuningResult
from rarms_iac.model.commands import PLAN, prose
from rarms_iac.planner.combining.candidates import ASSUMED
from rarms_iac.planner.combining.oracle import Coi, Members, SilentReporter
from rarms_iac.storage.datalog.decisions import TunedPartition, TuningRun
from rarms_iac.texts.messages import in_a_row
from rarms_iac.texts.quantities import show_lp_percent
from rarms_iac.views.console import paragraph, stack
from rarms_iac.views.table import Column, Table

if TYPE_CHECKING:
    from rich.console import RenderableType


class TuningProgress(SilentReporter):
    """A `PlannerReporter` that writes to a person. `MeasuringProgress` writes the settings."""

    def __init__(self, say: Callable[["RenderableType"], None]) -> None:
        self._say = say

    def declined(self, members: Members) -> None:
        """Say that it is left out."""
        self._say(paragraph(f"Not combined: {in_a_row(members)}."))

    def combined(self, compound: Coi, before: int) -> None:
        """Say what it brought."""
        names = in_a_row(compound.members)
        separate, together = show_lp_percent(before), show_lp_percent(compound.cost)
        self._say(paragraph(f"Combined: {names}, {separate} apart and {together} together."))


def tuned_text(result: TuningResult) -> "RenderableType":
    """Return the partitions, where there were some to tune, the result, and the next command."""
    *sentences, ending = _sentences(result)
    partitions, is_written = result.run.partitions, bool(result.files)
    has_next = is_written or result.run.ending == "nothing_to_do"
    return stack(
        *([partitions_table(partitions, {})] if partitions else []),
        *map(paragraph, sentences),
        paragraph(prose(ending, " Next: ", PLAN) if has_next else ending),
    )


PARTITIONS = (
    Column("partition", wraps=True),
    Column("components", wraps=True),
    Column("reservation", right=True, unit="LP", style="strong"),
    Column("CR", page_only=True),
    Column("apart", right=True, unit="LP"),
)


def partitions_table(partitions: Sequence[TunedPartition], remarks: Mapping[tuple[str, ...], str]) -> Table:
    """Return a row a partition as tuning left it; of a compound that it made also what its parts reserved apart.

    Args:
        remarks: what follows the components, by their sorted names.
    """
    rows = [
        (
            partition.name,
            ", ".join(partition.components) + remarks.get(tuple(sorted(partition.components)), ""),
            partition.reserved_lp,
            f"{partition.reserve} % of its VPs",
            partition.parts_lp,
        )
        for partition in partitions
    ]
    return Table(PARTITIONS, rows)


def _sentences(result: TuningResult) -> Sequence[str]:
    run, hosts = result.run, ", ".join(result.hosts)
    before, after, capacity = map(show_lp_percent, (run.before, run.after, run.capacity))
    fixed = f", {show_lp_percent(run.fixed)} of it by partitions that are not tuned" if run.fixed else ""
    match run.ending:
        case "nothing_to_do":
            return [f"{hosts}: nothing to do, {before} are reserved{fixed}; the capacity is {capacity}."]
        case "stopped":
            return [f"{hosts}: stopped, {before} are reserved{fixed}; the capacity is {capacity}."]
        case "unable":
            doubts = describe_doubts(run)
            return [*doubts, f"{hosts}: {before} must be reserved{fixed}; the capacity is {capacity}. {run.message}."]
        case "successful":
            return [*describe_proof(run), f"Tuned {hosts}: {before} became {after}{fixed}, of {capacity}."]


def describe_proof(run: TuningRun) -> Sequence[str]:
    """Say whether another layout may be better, and why."""
    proved = (
        [f"No other layout of these components is better by `policy.minimise`, assuming that {ASSUMED}."]
        if run.proved
        else []
    )
    return [*proved, *describe_doubts(run)]


def describe_doubts(run: TuningRun) -> Sequence[str]:
    """Return a sentence with the compounds by which nothing is proved; none without a doubt."""
    doubts = [f"{'+'.join(doubt.components)} at {doubt.unresolved} % of its VPs" for doubt in run.doubts]
    return [f"A better layout may exist. Not clear: {in_a_row(doubts)}."] if doubts else []


def manifest_changes(result: TuningResult) -> tuple[str, ...]:
    """Return the changes of the manifest, a sentence each."""
    gone = (
        f"Removed the entry of partition {name}: its components are now in other partitions." for name in result.removed
    )
    return (*gone, *(f"Written to {file}." for file in result.files))


def tuning_text(tuning: PlatformTuning) -> str:
    """Return the result, and whether it is the best there is."""
    run = tuning.run
    before, after, capacity = (show_lp_percent(amount) for amount in (run.before, run.after, run.capacity))
    result = f"{before} became {after}" if run.before != run.after else before
    result += f", the capacity is {capacity}"
    proof = "".join(f" {sentence}" for sentence in describe_proof(run))
    broken = f" Nothing is proven: {'; '.join(run.contradictions)}." if run.contradictions else ""
    written = "" if run.written or run.ending != "successful" else " The manifest was not changed."
    ending = (run.message or run.ending.replace("_", " ")).capitalize()
    outdated = "".join(f" {'+'.join(names)} is outdated: {why}." for names, why in tuning.outdated.items())
    return f"{ending}: {result} ({run.strategy} strategy, {run.when}).{proof}{broken}{written}{outdated}"
