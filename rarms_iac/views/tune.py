"""`rarms tune`: a table of the settings it asks for, updated in place, and the partitions that it leaves."""

from collections.abc import Callable, Mapping, Sequence
from typing import TYPE_CHECKING

from rarms_iac.app.report_model import PlatformTuning
from rarms_iac.measuring.tune import TuningResult
from rarms_iac.model.quantities import show_lp_percent
from rarms_iac.model.wording import in_a_row
from rarms_iac.planner.combining.candidates import ASSUMED
from rarms_iac.planner.combining.oracle import Answer, Coi, Members, SilentReporter
from rarms_iac.storage.datalog.decisions import TunedPartition, TuningRun
from rarms_iac.views.console import paragraph, stack
from rarms_iac.views.table import Column, LiveRows, Table

if TYPE_CHECKING:
    from rich.console import RenderableType


SETTINGS = (Column("components", wraps=True), Column("reservation", right=True), Column("answer", wraps=True))


class TuningProgress(SilentReporter):
    """A `PlannerReporter` that writes to a person: rows of a table on a terminal, lines in a pipe.

    Args:
        say: writes something for good.
        live: the table in which measuring shows its running setting; None: there is no terminal.
    """

    def __init__(self, say: Callable[["RenderableType"], None], live: LiveRows | None = None) -> None:
        self._say = say
        self._live = live

    def setting_answered(self, answer: Answer) -> None:
        """Show the answer."""
        predicted = "" if answer.predicted is None else f" (predicted {answer.predicted} % of its VPs)"
        row = "+".join(answer.members), f"{answer.reserve} % of its VPs", f"{answer_text(answer)}{predicted}"
        if self._live is None:
            self._say(paragraph(f"{row[0]} at {row[1]}: {row[2]}"))
        else:
            self._live.rows.append(row)

    def declined(self, members: Members) -> None:
        """Say that it is left out."""
        self._say(paragraph(f"Not combined: {in_a_row(members)}."))

    def combined(self, compound: Coi, before: int) -> None:
        """Say what it brought."""
        names = in_a_row(compound.members)
        separate, together = show_lp_percent(before), show_lp_percent(compound.cost)
        self._say(paragraph(f"Combined: {names}, {separate} apart and {together} together."))

    def ended(self) -> None:
        """Leave the table on the terminal."""
        if self._live is not None and self._live.rows:
            self._say(Table(SETTINGS, tuple(self._live.rows)))
            self._live.rows.clear()


def answer_text(answer: Answer) -> str:
    """Write whether a setting is enough for the components together, or who misses a threshold."""
    if answer.passed:
        return "all met"
    return f"{'not shown for' if answer.unresolved else 'missed by'} {', '.join(answer.worse)}"


def tuned_text(result: TuningResult) -> "RenderableType":
    """Return the partitions, where there were some to tune, and what all of it came to."""
    sentences = map(paragraph, _sentences(result))
    partitions = result.run.partitions
    return stack(*([partitions_table(partitions, {})] if partitions else []), *sentences)


PARTITIONS = (
    Column("partition", wraps=True),
    Column("components", wraps=True),
    Column("reservation", right=True, unit="LP", style="strong"),
    Column("CR"),
    Column("apart", right=True, unit="LP"),
)


def partitions_table(partitions: Sequence[TunedPartition], remarks: Mapping[tuple[str, ...], str]) -> Table:
    """Return a row a partition as tuning left it; of a compound that it made also what its parts reserved apart.

    Args:
        partitions: as tuning left them.
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
            return [f"{hosts}: {before} must be reserved{fixed}; the capacity is {capacity}. {run.message}.", *doubts]
        case "successful":
            became = f"{hosts}: {run.message}, {before} became {after}{fixed}; the capacity is {capacity}."
            return [became, *describe_proof(run)]


def describe_proof(run: TuningRun) -> Sequence[str]:
    """Say whether another layout may be better, and why."""
    proved = (
        [f"No other layout of these components is better by `policy.minimise`, assuming that {ASSUMED}."]
        if run.proved
        else []
    )
    return [*proved, *describe_doubts(run)]


def describe_doubts(run: TuningRun) -> Sequence[str]:
    """Name the compounds by which nothing is proved, a sentence each."""
    return [
        f"It is not proved that no other layout is better: {in_a_row(doubt.components)} together may need only "
        f"{doubt.shown} % of their VPs, since the samples did not tell at {doubt.unresolved} % of them."
        for doubt in run.doubts
    ]


def manifest_changes(result: TuningResult) -> tuple[str, ...]:
    """Say what became of the manifest, a sentence each."""
    gone = (f"The entry of partition {name} is gone: its components are elsewhere now." for name in result.removed)
    return (*gone, *(f"Written to {file}." for file in result.files))


def tuning_text(tuning: PlatformTuning) -> str:
    """Return what came of it, and whether it is the best there is."""
    run = tuning.run
    before, after, capacity = (show_lp_percent(amount) for amount in (run.before, run.after, run.capacity))
    result = f"{before} became {after}" if run.before != run.after else before
    result += f", the capacity is {capacity}"
    proof = "".join(f" {sentence}" for sentence in describe_proof(run))
    broken = f" Nothing is proved: {'; '.join(run.contradictions)}." if run.contradictions else ""
    written = "" if run.written or run.ending != "successful" else " The manifest was left as it is."
    ending = (run.message or run.ending.replace("_", " ")).capitalize()
    outdated = "".join(f" {'+'.join(names)} is outdated: {why}." for names, why in tuning.outdated.items())
    return f"{ending}: {result} ({run.strategy} strategy, {run.when}).{proof}{broken}{written}{outdated}"
