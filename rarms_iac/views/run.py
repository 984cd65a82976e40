"""Applying and undoing: what is going to be done, what goes on, and how it ended.

`RunProgress` is a `RunReporter` that writes a line for each partition, and shows the running step on a terminal.
"""

from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, Self

from rarms_iac.app.undoing import UndoPreview
from rarms_iac.applying.refusals import GO_ON, UNDO_PARTIAL
from rarms_iac.applying.run_report import (
    HostReport,
    ReportedStep,
    RunBegun,
    RunEnding,
    RunReport,
    RunReporter,
    StepEnded,
)
from rarms_iac.applying.undo import UndoneStep
from rarms_iac.model.commands import PLAN, PROVE, START, STATUS, UNDO, RecommendedCommand, Wording, command, prose
from rarms_iac.model.journal import RunKind, StepStatus
from rarms_iac.model.plan import HostPlan, Purpose, UndoLevel
from rarms_iac.texts.messages import counted
from rarms_iac.texts.quantities import show_processors
from rarms_iac.views.changes import describe_counts, members_of
from rarms_iac.views.console import paragraph, show_seconds, stack, visible
from rarms_iac.views.json_output import json_of
from rarms_iac.views.table import Column, LiveRow, Table

if TYPE_CHECKING:
    from rich.console import RenderableType

GOES_ON = {
    Purpose.APPLY: "Applying plan",
    Purpose.DESTROY: "Destroying by plan",
    Purpose.IMPORT: "Importing by plan",
    Purpose.RELEASE: "Releasing by plan",
    Purpose.STOP: "Stopping by plan",
    Purpose.START: "Starting by plan",
}
"""What goes on, as the user's command names it."""

DONE = {
    Purpose.APPLY: "Applied",
    Purpose.DESTROY: "Destroyed",
    Purpose.IMPORT: "Imported",
    Purpose.RELEASE: "Released",
    Purpose.STOP: "Stopped",
    Purpose.START: "Started",
}

LONGEST = 500
"""Characters that are shown of a line of a host: of its output, or of a script in its journal."""


UNDONE = (Column("resource", wraps=True), Column("undo", wraps=True))


def undo_text(undo: UndoPreview) -> "RenderableType":
    """List the steps of an undo in their order, with those that it cannot undo, and the resources that stay."""
    started = undo.started
    rows = [(step.address, _describe_undone(step)) for step in undo.steps]
    rows += [(address, "stays as applied") for address in undo.foreign if undo.keeps]
    script = [f"  {visible(line[:LONGEST], keep='')}" for line in undo.script]
    return stack(
        paragraph(
            f"Undo of the {started.purpose.value} of plan {started.plan} on {undo.host}, started by "
            f"{visible(started.started_by, keep='')}. The last change is undone first:"
        ),
        Table(UNDONE, rows, indent=2),
        *(script or ([] if rows else ["  no step changed anything"])),
    )


def _describe_undone(step: UndoneStep) -> str:
    stays = "stays done: " if step.level is UndoLevel.NONE else ""
    partly = ", in part" if step.level is UndoLevel.PARTIAL else ""
    return f"{stays}{visible(step.title, keep='')}{partly}"


@dataclass(slots=True, kw_only=True)
class _PartitionProgress:
    """The progress of a run with one partition, or with one thing of the host itself."""

    described: str  # with its components
    total: int = 0  # steps; 0: unknown
    since: float = 0.0
    took: float = 0.0  # seconds in its steps
    done: int = 0
    changed: int = 0


class RunProgress(RunReporter):
    """A `RunReporter` that writes to a person: a line for each partition that is done, and the running step below it.

    Use it as a context manager.

    Args:
        write: takes a line and shows it at once; one that begins with blanks is an item.
        clock: seconds, from any start.
        live: the line of the running step; None: it is not shown.
    """

    def __init__(self, write: Callable[[str], None], clock: Callable[[], float], live: LiveRow | None) -> None:
        self._say = write
        self._clock = clock
        self._live = live
        self._partitions: dict[str, _PartitionProgress] = {}
        self._components: Mapping[str, Sequence[str]] = {}
        self._ended = self._known = 0  # partitions

    def __enter__(self) -> Self:
        """Show nothing before a run starts."""
        return self

    def __exit__(self, *_: object) -> None:
        """Show the partitions that were not finished."""
        self._end_host()

    def run_started(self, begun: RunBegun) -> None:
        """Say what begins or goes on."""
        self._end_host()
        self._components = begun.components
        kind = GOES_ON[begun.purpose] if begun.run is RunKind.APPLY else "Undoing plan"
        goes_on = f", continuing after step {begun.done}" if begun.done else ""
        self._write(f"{kind} {begun.plan} on {begun.host}{goes_on}")
        for address in begun.addresses:
            self._partition(address).total += 1
        self._ended, self._known = 0, len(self._partitions)

    def step_started(
        self,
        host: str,  # noqa: ARG002 - `run_started` names it, and hosts are walked one at a time
        number: int,
        total: int,
        step: ReportedStep,
    ) -> None:
        """Show the step with its partition."""
        partition = self._partition(str(step.address))
        partition.since = self._clock()
        if self._live is not None:
            self._live.show((f"step {number}/{total}", partition.described, visible(step.title, keep="")))

    def step_ended(
        self,
        host: str,  # noqa: ARG002 - one host at a time
        number: int,  # noqa: ARG002 - a person follows partitions, not steps
        total: int,  # noqa: ARG002 - likewise
        step: ReportedStep,
        status: StepStatus,
    ) -> None:
        """Count it; show the partition once its last step is done."""
        partition = self._partition(str(step.address))
        partition.took += self._clock() - partition.since
        partition.done += 1
        partition.changed += status is not StepStatus.UNCHANGED
        if partition.done == partition.total:
            self._end(partition)

    def host_output(self, host: str, line: str) -> None:
        """Show it apart from the partitions, without what would move the cursor."""
        self._write(f"  {host} printed: {visible(line[:LONGEST], keep='')}")

    def _write(self, line: str) -> None:
        if self._live is not None:
            self._live.hide()
        self._say(line)

    def _partition(self, address: str) -> _PartitionProgress:
        name = "/".join(address.split("/")[1:2] if address.startswith("partition/") else [address])
        described = visible(name + members_of(name, self._components), keep="")
        return self._partitions.setdefault(name, _PartitionProgress(described=described))

    def _end(self, partition: _PartitionProgress) -> None:
        """Write `[1/4] vision  7 steps  0.2 s`; without a number if it is not done or the partitions are not known."""
        number, steps = "", counted(partition.done, "step")
        took = show_seconds(partition.took) if partition.changed else "already as planned"
        if partition.total > partition.done:
            steps, took = f"{partition.done} of {partition.total} steps", show_seconds(partition.took)
        elif partition.total:
            self._ended += 1
            number = f"[{self._ended}/{self._known}] "
        self._write(f"{number}{partition.described}  {steps}  {took}")

    def _end_host(self) -> None:
        for partition in self._partitions.values():
            if partition.done and partition.done != partition.total:
                self._end(partition)
        self._partitions.clear()
        if self._live is not None:
            self._live.hide()


def run_text(report: RunReport, following: RecommendedCommand | None = None) -> "RenderableType":
    """Return one sentence for each host, and the next command; findings are shown elsewhere.

    Args:
        following: the command to recommend; None: none, or the ending says how to continue.
    """
    sentences = [*_sentences(report)]
    if following is not None:
        sentences[-1] = prose(sentences[-1], " Next: ", following)
    return stack(*map(paragraph, sentences))


NEXT: Mapping[Purpose, RecommendedCommand] = {Purpose.APPLY: PROVE, Purpose.STOP: START, Purpose.IMPORT: PLAN}
"""The command after a run that is done; after other runs it is `rarms status`."""


def next_command(report: RunReport, *, answers: bool) -> RecommendedCommand | None:
    """Return the command to recommend after a run; None: the run is not done, or it had nothing to do.

    Args:
        answers: whether somebody can be asked; without, a proof needs its consent in the command.
    """
    if report.ending is not RunEnding.DONE or not report.hosts:
        return None
    last = report.hosts[-1]
    following = NEXT.get(last.purpose, STATUS) if last.run is RunKind.APPLY else STATUS
    return following if answers or following != PROVE else command("prove", load_host=True)


def _sentences(report: RunReport) -> Iterator[Wording]:
    partial = any(diagnostic.code == UNDO_PARTIAL.code for diagnostic in report.findings)
    for host in report.hosts:
        yield _reported_host(host, partial=partial)
    match report.ending:
        case RunEnding.NOTHING:
            yield "Nothing to do."
        case RunEnding.INTERRUPTED:
            yield prose("Stopped after the current step. " if report.hosts else "Stopped. ", GO_ON)
        case RunEnding.DONE | RunEnding.REFUSED | RunEnding.FAILED:
            pass


def _reported_host(report: HostReport, *, partial: bool) -> str:
    is_undo = report.run is RunKind.UNDO
    name = "undo" if is_undo else report.purpose.value
    if is_undo and report.ending is RunEnding.DONE and not report.total:
        why = "The run cannot be undone" if partial else "The run changed nothing"
        return f"Nothing to undo on {report.host}. {why}."
    steps = f"{counted(report.changed, 'step')} done"
    if report.unchanged:
        steps += f", {report.unchanged} not needed"
    if report.ending is not RunEnding.DONE:
        remaining = report.total - report.changed - report.unchanged
        return f"The {name} on {report.host} is not complete: {steps}, {remaining} of {report.total} left."
    if report.host_plan is not None and report.host_plan.changes:
        steps = describe_counts([report.host_plan], done=True)
    earlier = ", continued from an earlier run" if report.resumed else ""
    done = "Undone" if is_undo else DONE[report.purpose]
    return f"{done} on {report.host}{earlier}: {steps}.{_reserved(report.host_plan)}"


def _reserved(part: HostPlan | None) -> str:
    """Write as ` Reserved: 1.92 LP of 2 LP.`; empty if that is unknown."""
    totals = None if part is None else part.host_totals
    if totals is None:
        return ""
    return f" Reserved: {show_processors(totals.reserved_lp)} of {show_processors(totals.host_lp)}."


class StepLines(RunReporter):
    """A `RunReporter` for programs: a line of JSON for each step that ended."""

    def __init__(self, write: Callable[[str], None]) -> None:
        self._write = write

    def step_ended(self, host: str, number: int, total: int, step: ReportedStep, status: StepStatus) -> None:
        """Write it at once."""
        self._write(
            json_of(
                StepEnded(
                    host=host,
                    number=number,
                    total=total,
                    address=str(step.address),
                    title=step.title,
                    status=status,
                ),
                indent=None,
            )
        )


def interruption_text(ending: str, command: str, *, begun: bool) -> "RenderableType":
    """Say that a command was interrupted or terminated, and how to go on; an empty line stands before it.

    Args:
        begun: whether it had begun to measure, or to change a host.
    """
    advice = _advice_to_resume(command)
    return stack("", paragraph(prose(f"rarms was {ending}.", " Nothing was done." if advice and not begun else advice)))


def _advice_to_resume(command: str) -> Wording:
    """Say what to do after an interrupt, with a space before it; nothing where the command leaves nothing behind."""
    if command in {"measure", "prove", "tune"}:
        return " Results are saved; run the same command to continue."
    if command == "undo":
        return " If it was changing a host, run the same command again to finish the change."
    if command in {"apply", "destroy", "import", "release", "start", "stop"}:
        return prose(
            " If it was changing a host, run the same command again to finish the change, or ", UNDO, " to reverse it."
        )
    return ""
