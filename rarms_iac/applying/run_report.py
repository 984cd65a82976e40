"""The report of a run, host by host, and how the whole of it ended."""

from collections.abc import Sequence
from dataclasses import dataclass, field
from enum import StrEnum
from typing import Protocol

from rarms_iac.model.changes import Address, Change
from rarms_iac.model.diagnostics import Diagnostic
from rarms_iac.model.journal import RunKind, StepStatus


class RunEnding(StrEnum):
    """How a run ended; the command line turns it into an exit code (DESIGN section 9)."""

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
    resumed: bool = False  # it finished a run that had been begun earlier
    changes: tuple[Change, ...] = ()  # of an apply: what its plan does to resources


@dataclass(frozen=True, slots=True, kw_only=True)
class RunReport:
    """All hosts in the order they were walked, and what went wrong."""

    ending: RunEnding
    hosts: tuple[HostReport, ...] = ()
    diagnostics: tuple[Diagnostic, ...] = field(default=())


class ReportedStep(Protocol):
    """A step as a reporter is told of it, whether rarms walks it or a script does."""

    @property
    def address(self) -> Address | str:
        """The resource that it changes."""
        ...

    @property
    def title(self) -> str:
        """The step in a few words, for a person."""
        ...


@dataclass(frozen=True, slots=True, kw_only=True)
class TitledStep:
    """A step of a script, as its events name it."""

    address: str
    title: str


class RunReporter(Protocol):
    """Told while a run goes on; must not raise."""

    def run_started(self, host: str, run: RunKind, plan: str, *, done: int, addresses: Sequence[str] = ()) -> None:
        """A host's run begins, or goes on after so many steps that were done earlier.

        Args:
            host: its name.
            run: apply or undo.
            plan: its id.
            done: how many steps were done earlier.
            addresses: of the steps to come, in order; empty where only the script that runs knows them.
        """
        ...

    def step_started(self, host: str, number: int, total: int, step: ReportedStep) -> None:
        """A step is about to be looked at; `number` counts from 1."""
        ...

    def step_ended(self, host: str, number: int, total: int, step: ReportedStep, status: StepStatus) -> None:
        """A step is done, or was as wanted already."""
        ...

    def host_output(self, host: str, line: str) -> None:
        """The host said something beside its steps."""
        ...


class SilentRunReporter:
    """The default: tells nobody."""

    def run_started(self, host: str, run: RunKind, plan: str, *, done: int, addresses: Sequence[str] = ()) -> None:
        """Nothing."""

    def step_started(self, host: str, number: int, total: int, step: ReportedStep) -> None:
        """Nothing."""

    def step_ended(self, host: str, number: int, total: int, step: ReportedStep, status: StepStatus) -> None:
        """Nothing."""

    def host_output(self, host: str, line: str) -> None:
        """Nothing."""
