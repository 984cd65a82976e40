"""`rarms history`: what was done to the hosts, the last run first."""

from collections.abc import Sequence
from typing import TYPE_CHECKING

from rarms_iac.app.status import History
from rarms_iac.applying.refusals import describe_missing_journal
from rarms_iac.model.journal import Closing, PastRun, RunKind
from rarms_iac.views.console import CHANGED, STRONG, paragraph, stack, styled
from rarms_iac.views.table import Column, Table

if TYPE_CHECKING:
    from rich.console import RenderableType


RUNS = (
    Column("when"),
    Column("run"),
    Column("plan"),
    Column("application", wraps=True),
    Column("by", wraps=True),
    Column("ending", wraps=True),
)


def describe_run(run: PastRun) -> str:
    """`apply of plan 0123, done; by ann@lab, process 7, 2026-11-22 10:11:12 UTC`."""
    robot = f" on {run.robot}" if run.robot else ""
    return f"{_command(run)} of plan {run.plan}{robot}, {_ending(run)}; by {run.started_by}, {run.started_at}"


def history_text(history: History) -> "RenderableType":
    """Show the runs on each host, the last one first; what was taken back is said at the apply."""
    parts: list[RenderableType] = []
    for host, runs in history.hosts.items():
        marked = history.unrecorded.get(host)
        parts.append(styled((f"Host {host}", STRONG), "" if runs or marked else "  nothing was applied here"))
        if marked:
            parts.append(paragraph(styled((describe_missing_journal(host, marked), CHANGED)), indent=2, more=2))
        parts.append(Table(RUNS, history_rows(runs), indent=2))
    return stack(*parts)


def history_rows(runs: Sequence[PastRun]) -> Sequence[tuple[str, ...]]:
    """When, what, which plan of which application and robot, by whom, and how it ended; the last run first.

    Args:
        runs: of a host, the oldest first.
    """
    rows = []
    for number, run in enumerate(runs, start=1):
        whose = f"{run.application} on {run.robot}" if run.robot else run.application
        ending = _ending(run, runs[number:])
        rows.append((run.started_at, _command(run), run.plan, whose, run.started_by, ending))
    return rows[::-1]


def _command(run: PastRun) -> str:
    return run.purpose.value if run.run is RunKind.APPLY else run.run.value


def _ending(run: PastRun, later: Sequence[PastRun] = ()) -> str:
    """How a run ended, or that one after it took it back."""
    undos = (other for other in later if other.run is RunKind.UNDO and other.plan == run.plan)
    if run.run is RunKind.APPLY and any(undo.closing is Closing.DONE for undo in undos):
        return "undone"
    return run.ending
