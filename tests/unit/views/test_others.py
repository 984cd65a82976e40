import io
import json
from dataclasses import replace
from typing import Any

import pytest

from rarms_iac.app.drift import ComparedHost, DriftReport
from rarms_iac.app.graph import LayoutGraph
from rarms_iac.app.status import History
from rarms_iac.app.undoing import UndoPreview
from rarms_iac.applying.refusals import UNDO_PARTIAL
from rarms_iac.applying.run_report import HostReport, RunBegun, RunEnding, RunReport
from rarms_iac.applying.undo import UndoneStep
from rarms_iac.diff.drift import DriftKind, ResourceDrift
from rarms_iac.model.changes import Address
from rarms_iac.model.commands import PLAN, PROVE, START, STATUS, RecommendedCommand, command
from rarms_iac.model.journal import Closing, PastRun, RunKind, RunStarted, StepStatus
from rarms_iac.model.layout import Layout
from rarms_iac.model.plan import Purpose, Step, UndoLevel
from rarms_iac.model.seen_host import SeenHost
from rarms_iac.model.state import State
from rarms_iac.model.totals import Totals
from rarms_iac.views.changes import drift_text
from rarms_iac.views.console import live_console, render
from rarms_iac.views.graph import graph_text, mermaid_quoted
from rarms_iac.views.json_output import json_of
from rarms_iac.views.run import DONE, RunProgress, next_command, run_text, undo_text
from rarms_iac.views.status import history_text
from rarms_iac.views.table import LiveLine, LiveRow
from tests.builders import a_host, the_delivery_robot
from tests.builders_plan import (
    create,
    facts,
    host_plan,
    partition,
    placed_partition,
    plan,
    settings,
    step,
    task,
    update,
)
from tests.unit.views.test_json import check


def a_drift(*kinds: DriftKind) -> DriftReport:
    change = update(partition(settings(reserve=50)), partition(settings(reserve=40)))
    drifted = tuple(
        ResourceDrift(
            address=Address(partition="vision"),
            drift=kind,
            message="why",
            components=("face-detection", "vision"),
            change=change,
        )
        for kind in kinds
    )
    state = State(facts=facts(), partitions=(partition(),))
    seen = SeenHost(host=a_host(), application="robot", state=state)
    host = ComparedHost(seen=seen, drifted=drifted)
    return DriftReport(application="robot", hosts=(host,), unfinished={})


def test_no_drift_is_one_line() -> None:
    assert render(drift_text(a_drift())) == "No drift. The partitions of rarms are unchanged, and match the manifest.\n"


def test_unwritten_host_is_not_called_unchanged() -> None:
    report = a_drift()
    (host,) = report.hosts
    empty = replace(host.seen, state=replace(host.seen.state, partitions=()))
    untouched = replace(report, hosts=(replace(host, seen=empty),))

    assert render(drift_text(untouched)) == "No drift. No resource of robot exists on onboard.\n"


def test_drift_says_what_differs_and_who_moved() -> None:
    shown = render(drift_text(a_drift(DriftKind.HOST_CHANGED, DriftKind.NOT_APPLIED))).splitlines()

    assert shown[0] == "Host onboard (2 LP)"
    assert shown[1:4] == [
        "  resource                     state                setting  on the host  wanted",
        "  vision [face-detection,      changed on the host  reserve         1 LP  0.8 LP",
        "  vision]",
    ]
    assert shown[-2:] == [
        "Drift: 1 changed on the host, 1 not applied yet.",
        "Next: `rarms plan` shows the changes that are not applied.",
    ]


def test_drift_for_programs() -> None:
    text = json_of(a_drift(DriftKind.BOTH))

    check(text)
    (host,) = json.loads(text)["hosts"]
    (drifted,) = host.pop("drifted")
    assert host == {"name": "onboard", "host_lp": 2, "host_changed": 1, "not_applied": 0, "unused": 0}
    assert drifted["change"]["attributes"][0]["before"] == 50
    assert (drifted["components"], drifted["change"]["reserved_lp"]) == (["face-detection", "vision"], 0.8)
    assert (drifted["address"], drifted["drift"]) == ("partition/vision", "both")


def a_report(ending: RunEnding, changed: int = 2) -> RunReport:
    host = HostReport(
        host="onboard", plan="0123456789ab", run=RunKind.APPLY, ending=ending, changed=changed, unchanged=1, total=4
    )
    return RunReport(ending=ending, hosts=(host,))


def test_run_recommends_the_next_command() -> None:
    def after(**facts: Any) -> RecommendedCommand | None:
        report = a_report(RunEnding.DONE)
        return next_command(replace(report, hosts=(replace(report.hosts[0], **facts),)), answers=True)

    assert after() == PROVE
    assert next_command(a_report(RunEnding.DONE), answers=False) == command("prove", load_host=True)
    assert after(purpose=Purpose.STOP) == START
    assert after(purpose=Purpose.IMPORT) == PLAN
    assert after(purpose=Purpose.RELEASE) == STATUS
    assert after(purpose=Purpose.STOP, run=RunKind.UNDO) == STATUS
    assert next_command(a_report(RunEnding.FAILED), answers=True) is None
    assert next_command(RunReport(ending=RunEnding.NOTHING), answers=True) is None


def test_run_says_ending_and_rest() -> None:
    done = render(run_text(a_report(RunEnding.DONE, changed=3)), 100)
    stopped = render(run_text(a_report(RunEnding.INTERRUPTED)), 80)

    assert done == "Applied on onboard: 3 steps done, 1 not needed.\n"
    assert "1 of 4 left" in stopped
    assert "or `rarms apply --abandon` to leave" in stopped
    check(json_of(a_report(RunEnding.DONE)))


def test_apply_counts_resources_as_plan_did() -> None:
    report = a_report(RunEnding.DONE, changed=3)
    added = (
        create(partition(settings("speech"))),
        create(task("Heard", inside="speech")),
        create(task("Said", inside="speech")),
    )
    changes = (*added, update(partition(settings()), partition(settings(reserve=30))))
    promised = host_plan(changes=changes, totals=Totals(percent=140, memory=0))
    applied = replace(promised, components={"speech": ("recognition", "synthesis")})
    done = replace(report, hosts=tuple(replace(host, host_plan=applied) for host in report.hosts))

    assert render(run_text(done), 200) == (
        "Applied on onboard: 3 added (2 task classes with their partitions), 1 changed, 0 removed. "
        "Reserved: 1.4 LP of 2 LP.\n"
    )
    check(json_of(done))
    (host,) = json.loads(json_of(done))["hosts"]
    assert host["totals"]["reserved_lp"] == 1.4
    assert [change["reserved_lp"] for change in host["changes"]] == [0.8, None, None, 0.6]
    assert host["components"] == {"speech": ["recognition", "synthesis"]}


@pytest.mark.parametrize("purpose", [purpose for purpose in Purpose if purpose is not Purpose.APPLY])
def test_run_has_name_of_its_command(purpose: Purpose) -> None:
    report = a_report(RunEnding.DONE, changed=3)
    (host,) = report.hosts
    said: list[str] = []

    with RunProgress(said.append, lambda: 0.0, None) as reporter:
        reporter.run_started(RunBegun(host="onboard", run=RunKind.APPLY, plan=host.plan, done=0, purpose=purpose))
    shown = render(run_text(replace(report, hosts=(replace(host, purpose=purpose),))), 200)

    assert shown.startswith(f"{DONE[purpose]} on onboard: ")
    assert said[0].startswith(purpose.value.capitalize().removesuffix("e"))
    assert said[0].endswith("ing by plan 0123456789ab on onboard")


def test_an_undo_without_a_step_says_why() -> None:
    host = HostReport(
        host="onboard", plan="0123456789ab", run=RunKind.UNDO, ending=RunEnding.DONE, changed=0, unchanged=0, total=0
    )
    idle = RunReport(ending=RunEnding.DONE, hosts=(host,))
    lost = replace(idle, findings=(UNDO_PARTIAL.at(None, "what", "do"),))

    assert render(run_text(idle), 100) == "Nothing to undo on onboard. The run changed nothing.\n"
    assert render(run_text(lost), 100) == "Nothing to undo on onboard. The run cannot be undone.\n"


def a_start() -> RunStarted:
    return RunStarted(
        run=RunKind.APPLY,
        plan=plan().id,
        application="robot",
        started_by="me",
        started_at="2026-11-20 09:00:00 UTC",
        host_plan=host_plan(),
        steps=(step(),),
        serials={"robot": 4},
    )


def progress(live: LiveRow | None, *steps: Step, ended: int) -> str:
    said: list[str] = []
    times = iter(number / 4 for number in range(100))
    with RunProgress(said.append, lambda: next(times), live) as reporter:
        begun = RunBegun(
            host="onboard",
            run=RunKind.APPLY,
            plan=plan().id,
            done=0,
            addresses=[str(step.address) for step in steps],
            components={"vision": ("face-detection", "stream"), "speech": ("speech",)},
        )
        reporter.run_started(begun)
        for number, shown in enumerate(steps[:ended], 1):
            reporter.step_started("onboard", number, len(steps), shown)
            reporter.step_ended("onboard", number, len(steps), shown, StepStatus.CHANGED)
        reporter.host_output("onboard", "\x1b[2Jwarning")
    return "\n".join(said)


STEPS = (step(), step(Address(partition="speech")), step(Address(partition="vision", task="MotionControl")))


def test_partition_is_a_line_when_done() -> None:
    assert progress(None, *STEPS, ended=3).splitlines() == [
        "Applying plan 0123456789ab on onboard",
        "[1/2] speech  1 step  0.2 s",
        "[2/2] vision [face-detection, stream]  2 steps  0.5 s",
        "  onboard printed: <U+001B>[2Jwarning",
    ]


def test_early_end_says_progress_by_partition() -> None:
    last = progress(None, *STEPS, ended=1).splitlines()[-1]

    assert last == "vision [face-detection, stream]  1 of 2 steps  0.2 s"


def test_terminal_shows_running_step_in_place() -> None:
    stream = io.StringIO()
    progress(LiveLine(live_console(stream, 80, colour=False)), *STEPS, ended=3)

    assert "step 2/3  speech  " in stream.getvalue()
    assert "\x1b[2J" not in stream.getvalue()


def test_undo_says_what_comes_back_and_what_stays() -> None:
    steps = [
        UndoneStep(address="partition/vision", title="reserve 40 -> 70 %", level=UndoLevel.FULL),
        UndoneStep(address="partition/old", title="remove it", level=UndoLevel.NONE),
    ]

    shown = UndoPreview(
        host="onboard", started=a_start(), steps=tuple(steps), script=(), findings=(), foreign=(), keeps=False
    )

    assert render(undo_text(shown), 120).splitlines() == [
        ("Undo of the apply of plan 0123456789ab on onboard, started by me. The last change is undone first:"),
        "  resource          undo",
        "  partition/vision  reserve 40 -> 70 %",
        "  partition/old     stays done: remove it",
    ]


def a_layout() -> Layout:
    return Layout(
        partitions=(
            placed_partition("face-detection"),
            placed_partition("speech", components=("speech-recognition", "path-planning")),
        ),
        on_hosts=(("video-streaming", "onboard"),),
    )


def test_a_graph_nests_hosts_partitions_and_components() -> None:
    graph = LayoutGraph(application="robot", system=the_delivery_robot(), layout=a_layout())

    mermaid = graph_text(graph)

    assert '    subgraph n3["speech<br/>0.8 LP reserved (40 % of each of its VPs)<br/>512 MiB"]' in mermaid
    assert mermaid.count("subgraph ") == mermaid.count("end\n")
    check(json_of(graph))


def test_a_graph_escapes_what_its_language_would_read() -> None:
    assert mermaid_quoted('a"<b>', "#;") == "a#quot;#lt;b#gt;<br/>#35;#59;"


def test_only_undo_that_ended_well_makes_apply_undone() -> None:
    applied = PastRun(
        run=RunKind.APPLY, plan="0123", application="robot", started_by="ann", started_at="", closing=Closing.DONE
    )

    def endings(closing: Closing | None) -> list[str]:
        undo = replace(applied, run=RunKind.UNDO, closing=closing)
        shown = render(history_text(History(application="robot", hosts={"onboard": (applied, undo)}, unrecorded={})))
        return [line.split()[-1] for line in shown.splitlines()[2:]]

    assert endings(None) == ["unfinished", "done"]
    assert endings(Closing.ABANDONED) == ["abandoned", "done"]
    assert endings(Closing.DONE) == ["done", "undone"]


def test_history_names_the_application_of_others_only() -> None:
    own = PastRun(
        run=RunKind.APPLY, plan="0123", application="robot", started_by="ann", started_at="", closing=Closing.DONE
    )

    def titles(*runs: PastRun) -> list[str]:
        shown = render(history_text(History(application="robot", hosts={"onboard": runs}, unrecorded={})))
        return shown.splitlines()[1].split()

    assert titles(own) == ["when", "run", "plan", "by", "ending"]
    assert titles(own, replace(own, application="kiosk")) == ["when", "run", "plan", "application", "by", "ending"]
