"""What a script says of itself, as the report of a run: with a host that says what the test has written down."""

from collections.abc import Sequence
from dataclasses import dataclass, field, replace

import pytest

from rarms_iac.applying.run_report import ReportedStep, RunBegun, RunEnding, RunReport, RunReporter
from rarms_iac.applying.run_script import ScriptJob, finish_job, run_job
from rarms_iac.applying.run_steps import RunControl
from rarms_iac.applying.undo import undo_findings, why_not_kept
from rarms_iac.model.journal import RunKind, ScriptRun, ScriptStarted, StepRecorded, StepStatus
from rarms_iac.model.seen_host import SeenHost
from rarms_iac.model.state import State
from rarms_iac.powershell.render import render_scripts
from rarms_iac.powershell.templates import shipped_module
from rarms_iac.providers.interface import (
    EventKind,
    EventListener,
    EventStatus,
    RunEvent,
    ScriptBundle,
    ScriptedHost,
    ScriptExited,
    ScriptLost,
    WaitLimits,
)
from tests.builders import a_host
from tests.builders_plan import facts
from tests.cases.situations import CASES, made
from tests.unit.powershell.plans import rendered_plan

ORDER = ScriptJob(
    run=RunKind.APPLY, plan="0123456789ab", script=ScriptBundle(runs="x.ps1", files={"x.ps1": ""}), earlier={}
)


def event(
    kind: EventKind, status: EventStatus, *, number: int = 0, address: str = "partition/vision", detail: str = ""
) -> RunEvent:
    return RunEvent(
        kind=kind, plan="0123456789ab", number=number, total=2, address=address, status=status, detail=detail
    )


def step(status: EventStatus, number: int = 0, detail: str = "") -> RunEvent:
    return event(EventKind.STEP, status, number=number, detail=detail)


WELL = ScriptExited(code=0)
DONE = event(EventKind.RUN, EventStatus.DONE, address="host")


@dataclass
class Scripted:
    """A host whose script says these things, then ends so."""

    message: Sequence[RunEvent | str]
    ends: ScriptExited | ScriptLost
    name: str = "cell"
    heard: list[str] = field(default_factory=list)

    def observe(self) -> State:
        return State(facts=facts())

    def examined(self, application: str) -> SeenHost:
        return SeenHost(host=a_host("cell"), application=application, state=self.observe())

    def look_once(self) -> None:
        """Look each time."""

    def journal(self) -> ScriptRun | None:
        return None

    def unfinished(self) -> ScriptRun | None:
        return None

    def run_script(
        self, script: ScriptBundle, waits: WaitLimits, listener: EventListener, *, abandoning: bool = False
    ) -> ScriptExited | ScriptLost:
        for event in self.message:
            if isinstance(event, str):
                listener.on_output(event)
            else:
                listener.on_event(event)
        return self.ends


class Told(RunReporter):
    """A reporter that keeps what it is told, a line each."""

    def __init__(self) -> None:
        self.lines: list[str] = []

    def run_started(self, begun: RunBegun) -> None:
        self.lines.append(f"{begun.run.value} on {begun.host}, {begun.done} done")

    def step_started(self, host: str, number: int, total: int, step: ReportedStep) -> None:
        self.lines.append(f"{number}/{total} begins")

    def step_ended(self, host: str, number: int, total: int, step: ReportedStep, status: StepStatus) -> None:
        self.lines.append(f"{number}/{total} {step.address}: {step.title}: {status.value}")

    def host_output(self, host: str, line: str) -> None:
        self.lines.append(f"said {line}")


def ran(
    *message: RunEvent | str, ends: ScriptExited | ScriptLost = WELL, order: ScriptJob = ORDER
) -> tuple[RunReport, Told]:
    told = Told()
    host = Scripted(message, ends)
    assert isinstance(host, ScriptedHost)
    return run_job(host, order, RunControl(reporter=told)), told


def codes(report: RunReport) -> list[str]:
    return [diagnostic.code for diagnostic in report.findings]


def test_steps_are_told_as_a_walk_tells_them() -> None:
    report, told = ran(
        step(EventStatus.BEGUN, 0, "reserve 40 %"),
        step(EventStatus.CHANGED, 0, "reserve 40 %"),
        "WARNING: slow",
        step(EventStatus.UNCHANGED, 1),
        DONE,
    )

    assert told.lines == [
        "apply on cell, 0 done",
        "1/2 begins",
        "1/2 partition/vision: reserve 40 %: changed",
        "said WARNING: slow",
        "2/2 begins",
        "2/2 partition/vision: unchanged: unchanged",
    ]
    assert report.ending is RunEnding.DONE
    assert (report.hosts[0].changed, report.hosts[0].unchanged, report.hosts[0].total) == (1, 1, 2)
    assert not report.findings


@pytest.mark.parametrize(
    ("last", "ends", "ending", "code"),
    [
        (event(EventKind.RUN, EventStatus.STOPPED, address="host"), ScriptExited(code=1), RunEnding.INTERRUPTED, ""),
        (
            event(EventKind.LOCK, EventStatus.REFUSED, address="host"),
            ScriptExited(code=3),
            RunEnding.REFUSED,
            "RARMS184",
        ),
        (
            event(EventKind.REFUSED, EventStatus.REFUSED, address="host"),
            ScriptExited(code=3),
            RunEnding.REFUSED,
            "RARMS251",
        ),
        (event(EventKind.REFUSED, EventStatus.REFUSED), ScriptExited(code=3), RunEnding.REFUSED, "RARMS182"),
        (event(EventKind.FAILED, EventStatus.FAILED), ScriptExited(code=1), RunEnding.FAILED, "RARMS186"),
        (DONE, ScriptLost(why="the connection broke"), RunEnding.FAILED, "RARMS250"),
        (step(EventStatus.BEGUN), ScriptLost(why="no output for 600 s"), RunEnding.FAILED, "RARMS250"),
        (step(EventStatus.CHANGED), ScriptExited(code=0), RunEnding.FAILED, "RARMS250"),
        (step(EventStatus.CHANGED), ScriptExited(code=3), RunEnding.FAILED, "RARMS250"),
        (step(EventStatus.BEGUN), ScriptExited(code=137), RunEnding.FAILED, "RARMS250"),
    ],
)
def test_every_end_has_its_word(last: RunEvent, ends: ScriptExited | ScriptLost, ending: RunEnding, code: str) -> None:
    report, _ = ran(last, ends=ends)

    assert report.ending is ending
    assert codes(report) == ([code] if code else [])


def test_reading_host_is_told_and_no_step() -> None:
    report, told = ran(step(EventStatus.READING, detail="the host is still being read"), DONE)

    assert report.ending is RunEnding.DONE
    assert told.lines == ["apply on cell, 0 done", "said partition/vision: the host is still being read"]


def test_unstartable_script_is_told_in_powershells_words() -> None:
    report, _ = ran(ends=ScriptExited(code=1, last_lines=("cell.ps1 cannot be run: it lacks the module Hyper-V",)))

    assert "lacks the module Hyper-V (exit code 1)" in report.findings[0].detail


def test_finishing_counts_what_an_earlier_run_changed() -> None:
    script = render_scripts(*rendered_plan())["onboard.ps1"].decode("ascii")
    started = ScriptStarted(
        run=RunKind.APPLY,
        plan="a",
        application="robot",
        started_by="me",
        started_at="2026-11-20 09:00:00 UTC",
        script=script,
        undo=script,
        serials={},
        touched=(),
        module=shipped_module(),
    )
    begun = StepRecorded(number=1, status=StepStatus.BEGUN)
    journal = ScriptRun(started=started, steps=(StepRecorded(number=0, status=StepStatus.CHANGED), begun))
    order = finish_job("cell", journal)
    beside = {f"Rarms/{name}": text for name, text in shipped_module().items()}

    report, told = ran(step(EventStatus.UNCHANGED, 0, "done before"), step(EventStatus.CHANGED, 1), DONE, order=order)

    assert order.script == ScriptBundle(runs="cell.ps1", files={"cell.ps1": script, **beside}, longest_grace_ms=120_000)
    assert told.lines[0] == "apply on cell, 1 done"
    assert (report.hosts[0].changed, report.hosts[0].resumed) == (2, True)
    assert (
        finish_job("cell", replace(journal, started=replace(started, run=RunKind.UNDO))).script.runs == "cell.undo.ps1"
    )


def test_undo_script_names_foreign_values() -> None:
    """A host's script was written when the plan was made: its head has them, and it can leave out no step."""
    plan = made(CASES / "changed-by-hand").plan
    assert plan is not None
    script = plan.hosts[0].scripts["onboard.undo.ps1"]
    started = ScriptStarted(
        run=RunKind.APPLY,
        plan="a",
        application="robot",
        started_by="me",
        started_at="2026-11-20 09:00:00 UTC",
        script=script,
        undo=script,
        serials={},
        touched=(),
    )
    host, journal = Scripted([], WELL), ScriptRun(started=started)

    (found,) = undo_findings(host, journal)

    assert found.code == "RARMS402"
    assert "not set by rarms: partition/vision: reserve 1.1 LP; the plan sets 1.6 LP." in found.detail
    assert why_not_kept(host, journal) == "the script of the host undoes the whole apply"
