"""What a host remembers of the last run: its journal, and what follows from it."""

from collections.abc import Mapping
from dataclasses import dataclass, field
from enum import StrEnum
from typing import Literal

from rarms_iac.model.changes import Address
from rarms_iac.model.output import Internal, output
from rarms_iac.model.plan import HostPlan, Purpose, Step
from rarms_iac.model.version import __version__


class RunKind(StrEnum):
    """A run walks a plan's steps, or undoes those of an earlier run."""

    APPLY = "apply"
    UNDO = "undo"


class Closing(StrEnum):
    """The ending of a run."""

    DONE = "done"
    ABANDONED = "abandoned"


@dataclass(frozen=True, slots=True, kw_only=True)
class RunOrigin:
    """The user who starts a run, and the time."""

    by: str  # user@computer, process
    at: str  # UTC, `2026-01-31 12:00:00 UTC`: no ISO form, which PowerShell 7 would read back as a date


@dataclass(frozen=True, slots=True, kw_only=True)
class PastRun:
    """A run as the journals of later runs on the same host remember it."""

    run: RunKind
    plan: str  # id
    application: str
    started_by: str
    started_at: str  # as of `RunOrigin`
    closing: Internal[Closing | None]  # None: it did not end; an undo may have taken it back
    robot: str = ""  # of `Application`; empty: it has none
    purpose: Purpose = Purpose.APPLY  # of its plan

    @output
    def ending(self) -> Literal["done", "abandoned", "unfinished"]:
        """How it ended, if it did."""
        return "unfinished" if self.closing is None else self.closing.value


MOST_PAST_RUNS = 100
"""So many runs are remembered; older ones are forgotten, so that a journal does not grow for ever."""


@dataclass(frozen=True, slots=True, kw_only=True)
class RunStarted:
    """The first record: the whole run, so that anybody can finish it without the plan file or the manifest.

    Writing it starts the run, uses the plan and raises the serial, all in one write.
    """

    run: RunKind
    plan: str  # id
    application: str
    started_by: str  # user@computer, process
    host_plan: HostPlan
    steps: tuple[Step, ...]  # what this run walks; of an undo: the reversed steps
    serials: Mapping[str, int]  # of every application on the host, this run counted
    started_at: str  # as of `RunOrigin`
    robot: str = ""  # of `Application`
    purpose: Purpose = Purpose.APPLY  # of its plan
    rarms: str = __version__  # the version that began it, which ends it, too
    needs_key: bool = False  # of `Plan`
    history: tuple[PastRun, ...] = ()  # runs before this one, the oldest first
    kind: Literal["run_started"] = "run_started"


class StepStatus(StrEnum):
    """The progress of a step; `unchanged`: it was as wanted already."""

    BEGUN = "begun"
    CHANGED = "changed"
    UNCHANGED = "unchanged"


@dataclass(frozen=True, slots=True, kw_only=True)
class StepRecorded:
    """A step was begun or done."""

    number: int  # from 0, in the run's steps
    status: StepStatus
    kind: Literal["step_recorded"] = "step_recorded"


@dataclass(frozen=True, slots=True, kw_only=True)
class RunClosed:
    """The last record."""

    closing: Closing
    kind: Literal["run_closed"] = "run_closed"


JournalRecord = RunStarted | StepRecorded | RunClosed


@dataclass(frozen=True, slots=True, kw_only=True)
class _Run:
    """The progress of a run."""

    steps: tuple[StepRecorded, ...] = ()
    closed: RunClosed | None = None

    @property
    def unfinished(self) -> bool:
        """Whether the run was neither completed nor abandoned."""
        return self.closed is None

    def touched(self) -> frozenset[int]:
        """Return the numbers of the steps that may have changed the host in this run."""
        return frozenset(record.number for record in self.steps if record.status is not StepStatus.UNCHANGED)


@dataclass(frozen=True, slots=True, kw_only=True)
class Journal(_Run):
    """The last run on a host that rarms walks itself, as far as it got."""

    started: RunStarted


def open_starts(journal: Journal) -> tuple[tuple[int, Step], ...]:
    """Return the steps that give back what partitions have for their starts, where that was given and not given back.

    Returns:
        Their numbers in the run, and the steps; none where the run has ended.
    """
    if not journal.unfinished or journal.started.run is RunKind.UNDO:
        return ()
    touched = journal.touched()
    done = {record.number for record in journal.steps if record.status is not StepStatus.BEGUN}
    found: list[tuple[int, Step]] = []
    given: set[Address] = set()
    for number, step in enumerate(journal.started.steps):
        if step.wait_ms == 0 and number in touched:
            given.add(step.address)
        elif step.wait_ms and step.address in given and number not in done:
            found.append((number, step))
    return tuple(found)


@dataclass(frozen=True, slots=True, kw_only=True)
class ScriptStarted:
    """The first record that a script writes on its host: the whole run, with the texts of both scripts."""

    run: RunKind
    plan: str
    application: str
    started_by: str
    script: str
    undo: str
    serials: Mapping[str, int]
    touched: tuple[str, ...]  # of an undo: numbers of the steps of the apply that may have changed something
    started_at: str  # as of `RunOrigin`
    robot: str = ""  # of `Application`
    purpose: Purpose = Purpose.APPLY  # of its plan
    history: tuple[PastRun, ...] = ()  # runs before this one, the oldest first
    module: Mapping[str, str] = field(default_factory=dict)  # its files by name; none: the script holds it
    kind: Literal["run_started"] = "run_started"


@dataclass(frozen=True, slots=True, kw_only=True)
class ScriptRun(_Run):
    """The last run of a script on a host, as far as it got: what `Journal` is of a run that rarms walks."""

    started: ScriptStarted


def history_of(last: Journal | ScriptRun | None) -> tuple[PastRun, ...]:
    """List the runs on a host, the oldest first.

    Args:
        last: The last run there, which counts as well; None: there was none.

    Returns:
        At most the last `MOST_PAST_RUNS`.
    """
    if last is None:
        return ()
    started = last.started
    past = PastRun(
        run=started.run,
        plan=started.plan,
        application=started.application,
        started_by=started.started_by,
        started_at=started.started_at,
        closing=None if last.closed is None else last.closed.closing,
        robot=started.robot,
        purpose=started.purpose,
    )
    return (*started.history, past)[-MOST_PAST_RUNS:]
