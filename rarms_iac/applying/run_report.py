"""The report of a run, host by host, and how the whole of it ended."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from enum import StrEnum
from typing import Literal

from rarms_iac.model.changes import Change
from rarms_iac.model.diagnostics import Diagnostic
from rarms_iac.model.journal import RunKind, StepStatus
from rarms_iac.model.output import Internal, output
from rarms_iac.model.plan import HostPlan, Purpose, Step
from rarms_iac.model.totals import Totals


class RunEnding(StrEnum):
    """The ending of a run; the command line turns it into an exit code."""

    DONE = "done"
    NOTHING = "nothing"  # there was nothing to do
    REFUSED = "refused"  # moved, locked, used, edited, or another run is unfinished
    FAILED = "failed"
    INTERRUPTED = "interrupted"  # stopped after a step because the user asked


@dataclass(frozen=True, slots=True, kw_only=True)
class HostReport:
    """The steps that one host's run did, and how it ended."""

    host: str
    plan: str
    run: RunKind
    ending: RunEnding
    changed: int
    unchanged: int
    total: int
    purpose: Purpose = Purpose.APPLY  # of its plan
    resumed: bool = False  # it finished a run that had been begun earlier
    host_plan: Internal[HostPlan | None] = None  # of an apply that rarms walked: what its plan does, and to whom

    @output
    def changes(self) -> tuple[Change, ...]:
        """What an apply changes; nothing of an undo, or of a script's run."""
        return self.host_plan.changes if self.host_plan else ()

    @output
    def components(self) -> Mapping[str, tuple[str, ...]]:
        """By partition of an apply's layout, the most critical first."""
        return self.host_plan.components if self.host_plan else {}

    @output
    def totals(self) -> Totals | None:
        """What the host has promised once all of an apply is done."""
        return self.host_plan.totals if self.host_plan else None


@dataclass(frozen=True, slots=True, kw_only=True)
class StepEnded:
    """A step that ended, on a line of its own where programs read along."""

    kind: Literal["step"] = "step"
    host: str
    number: int  # from 1
    total: int
    address: str
    title: str
    status: StepStatus


@dataclass(frozen=True, slots=True, kw_only=True)
class RunReport:
    """All hosts in the order they were walked, and what went wrong."""

    kind: Literal["run"] = "run"
    ending: RunEnding
    hosts: tuple[HostReport, ...] = ()
    findings: tuple[Diagnostic, ...] = ()


@dataclass(frozen=True, slots=True, kw_only=True)
class TitledStep:
    """A step of a script, as its events name it."""

    address: str
    title: str


ReportedStep = Step | TitledStep
"""A step as a reporter receives it, whether rarms runs it or a script does."""


@dataclass(frozen=True, slots=True, kw_only=True)
class RunBegun:
    """A run of a host that begins, or goes on after so many steps that were done earlier."""

    host: str
    run: RunKind
    plan: str
    done: int
    purpose: Purpose = Purpose.APPLY  # of its plan
    addresses: Sequence[str] = ()  # of the steps to come, in order; empty where only the script that runs knows them
    # By partition of the plan's layout, the most critical first; likewise.
    components: Mapping[str, Sequence[str]] = field(default_factory=dict)


class RunReporter:
    """Receives the events of a run; must not raise. This one drops them."""

    def run_started(self, begun: RunBegun) -> None:
        """Report that a host's run begins or goes on."""

    def step_started(self, host: str, number: int, total: int, step: ReportedStep) -> None:
        """Report that a step is looked at next; `number` counts from 1."""

    def step_ended(self, host: str, number: int, total: int, step: ReportedStep, status: StepStatus) -> None:
        """Report that a step is done, or had nothing to do."""

    def host_output(self, host: str, line: str) -> None:
        """Report what the host said apart from its steps."""
