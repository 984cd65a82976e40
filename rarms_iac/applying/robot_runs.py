"""Runs that a robot's own rarms does whole: what is asked of it, and the reports that come back.

`rarms_iac.robot` does at the other end what this side asks for here. Begin at `run_there`.
"""

from dataclasses import dataclass, replace

from rarms_iac.applying.run_report import RunReport, RunReporter
from rarms_iac.applying.run_steps import RunControl
from rarms_iac.model.plan import HostPlan
from rarms_iac.providers.interface import HostFailed, RobotHost, RobotListener, WaitLimits
from rarms_iac.storage.codec import NotDecodable, decode, encode

STEPS = "steps"
"""The `RunReporter` of this side, as calls name it."""


@dataclass(frozen=True, slots=True, kw_only=True)
class ApplyJob:
    """A plan for the robot: its whole file."""

    plan: str
    waits: WaitLimits


@dataclass(frozen=True, slots=True, kw_only=True)
class RunJob:
    """A run of the robot that is finished or closed: the one of this plan, or nothing is done."""

    plan: str  # its id
    waits: WaitLimits


@dataclass(frozen=True, slots=True, kw_only=True)
class UndoJob(RunJob):
    """A run of the robot that is undone."""

    keep: bool  # as of `undo.undo`


def run_there(host: RobotHost, command: str, job: ApplyJob | RunJob, control: RunControl) -> RunReport:
    """Have the robot do a run, and return its report.

    Args:
        command: `apply`, `finish`, `abandon` or `undo`.
        control: hears of each step, and is asked whether to stop.

    Raises:
        HostError: the robot cannot be reached, refuses, or the connection broke.
    """
    listener = RobotListener(reporters={STEPS: (RunReporter, control.reporter)}, should_stop=control.should_stop)
    answer = host.ask(command, encode(job), listener)
    try:
        return decode(RunReport, answer)
    except NotDecodable as problem:
        raise HostFailed(host.name, f"its report cannot be read: {problem}", "Look there: rarms history.") from None


def without_plans(report: RunReport) -> RunReport:
    """Return a report as it travels, without its plan, which the other side has."""
    return replace(report, hosts=tuple(replace(host, host_plan=None) for host in report.hosts))


def with_plan(report: RunReport, part: HostPlan) -> RunReport:
    """Return a report that came, with the plan whose run it is about."""
    return replace(report, hosts=tuple(replace(host, host_plan=part) for host in report.hosts))
