"""What can be done on the page: each action is a body in JSON, the command that does the same, and one use case.

Every class has the fields of its body. `command` returns the words of a terminal, and `run` does the work when `work`
calls it. What an action may do without a question, the page asks in a box of its own, as the terminal asks or takes an
option.
"""

from collections.abc import Mapping
from dataclasses import dataclass, replace
from types import MappingProxyType
from typing import Annotated, ClassVar, Literal, assert_never

from pydantic import BaseModel, ConfigDict, Field

from rarms_iac.app.applying import apply, changed_manifest, finish_runs, refuse_contradiction
from rarms_iac.app.control import Control, StopSignal, always_consents, never_consents
from rarms_iac.app.hosts import Hosts, last_runs, select_hosts
from rarms_iac.app.manifests import load_manifest
from rarms_iac.app.planning import plan as make_plan
from rarms_iac.app.planning import plan_request
from rarms_iac.app.requests import SILENCE_MS, HostSelection, ManifestSource, today_utc
from rarms_iac.app.scripts import ScriptSince, scripts_since
from rarms_iac.app.undoing import last_applies, preview, undo_applies
from rarms_iac.app.use_case_errors import RequestError
from rarms_iac.applying.run_report import RunEnding, RunReport
from rarms_iac.measuring.measure import measure_components
from rarms_iac.measuring.measure_request import MeasureRequest, reserves_between
from rarms_iac.measuring.prove import ProveRequest, prove_layout
from rarms_iac.measuring.tune import TuneRequest, UnattendedTuning, tune_components
from rarms_iac.model.commands import APPLY, PLAN, START, RecommendedCommand, command
from rarms_iac.model.diagnostics import Diagnostic, has_errors
from rarms_iac.model.plan import Plan, Purpose
from rarms_iac.providers.interface import WaitLimits
from rarms_iac.studio.work import Ending, Transcript
from rarms_iac.texts.messages import STOPPED, in_a_row, quoted
from rarms_iac.views.measure import summary_text
from rarms_iac.views.run import run_text, undo_text
from rarms_iac.views.tune import TuningProgress, manifest_changes, tuned_text
from rarms_iac.views.verdicts import proof_text, stopped_proof

WAITS = WaitLimits(silence_ms=SILENCE_MS)

Percent = Annotated[int, Field(ge=1, le=100)]


@dataclass(slots=True, kw_only=True)
class Workspace:
    """The objects of all actions: the manifest, and the last plan that was made on the page."""

    source: ManifestSource
    plan: Plan | None = None
    does: RecommendedCommand = APPLY  # what makes and does such a plan in a terminal
    scripts: tuple[ScriptSince, ...] = ()  # of the plan

    def hosts(self) -> Hosts:
        """Read the manifest as it is now.

        Raises:
            UseCaseError: it has errors (negative).
        """
        return select_hosts(load_manifest(replace(self.source, today=today_utc())), HostSelection())


class Action(BaseModel):
    """A body that the page sends; fields that it does not know are refused."""

    model_config = ConfigDict(frozen=True, extra="forbid", strict=True)

    changes: ClassVar[bool] = True
    """Whether it changes a file or a host, or runs a component: refused where the studio is read-only."""

    def command(self) -> RecommendedCommand:
        """Return the words that do the same in a terminal."""
        raise NotImplementedError

    def run(self, workspace: Workspace, transcript: Transcript, stop: StopSignal) -> Ending:
        """Do it.

        Args:
            transcript: hears what a terminal would show.
            stop: asked as use cases ask.

        Returns:
            How it ended; failed also if it has no result.

        Raises:
            RequestError: it cannot be done as it was asked.
            UseCaseError: as of the use case.
        """
        raise NotImplementedError


class MeasureAction(Action):
    """Measure components; without names all with an APT."""

    components: list[str] = []
    together: bool = False
    coarse: bool = False  # a coarse curve to choose a level from, as the paper's session begins
    first: Percent | None = None  # settings from here ...
    last: Percent | None = None  # ... to here ...
    step: Percent | None = None  # ... so far apart; all None: a search
    stop_partitions: bool = False
    on_busy_host: bool = False
    weak_load: bool = False

    @property
    def _is_coarse(self) -> bool:
        """Settings that are named come before a coarse curve, as in a terminal."""
        return self.coarse and self.first is self.last is self.step is None

    def command(self) -> RecommendedCommand:
        """Return `rarms measure`."""
        settings = {"from_": self.first, "to": self.last, "step": self.step}
        chosen = {name: f"{value}%" for name, value in settings.items() if value is not None}
        return command(
            "measure",
            *self.components,
            together=self.together,
            interactive=self._is_coarse,
            **chosen,
            stop_partitions=self.stop_partitions,
            on_busy_host=self.on_busy_host,
            weak_load=self.weak_load,
        )

    def run(self, workspace: Workspace, transcript: Transcript, stop: StopSignal) -> Ending:
        """Measure; what is recorded stays."""
        request = MeasureRequest(
            components=tuple(self.components),
            together=self.together,
            reserves=reserves_between(self.first, self.last, self.step),
            coarse=self._is_coarse,
            weak_load=self.weak_load,
            on_busy_host=self.on_busy_host,
        )
        control = _measuring(transcript, stop, stops=self.stop_partitions, on_busy_host=self.on_busy_host)
        hosts = workspace.hosts()
        outcome = measure_components(hosts, request, control)
        transcript.findings(outcome.findings, hosts.manifest.sources)
        transcript.say(summary_text(outcome, verbose=True))
        return _ending(transcript, outcome.findings, stopped=outcome.stopped)


def _measuring(transcript: Transcript, stop: StopSignal, *, stops: bool, on_busy_host: bool) -> Control:
    if stops and on_busy_host:
        raise RequestError("Choose only one of the two boxes for partitions: stop them, or measure while they run.")
    return Control(reporter=transcript, stop=stop, consents=always_consents if stops else never_consents)


class WatchedTuning(TuningProgress, UnattendedTuning):
    """A `TuningPrompt` that shows how the search goes, and allows all of it."""


class TuneAction(Action):
    """Combine components."""

    dry_run: bool = False
    stop_partitions: bool = False
    on_busy_host: bool = False

    def command(self) -> RecommendedCommand:
        """Return `rarms tune`."""
        return command(
            "tune", dry_run=self.dry_run, stop_partitions=self.stop_partitions, on_busy_host=self.on_busy_host
        )

    def run(self, workspace: Workspace, transcript: Transcript, stop: StopSignal) -> Ending:
        """Tune; what is found is written into the manifest."""
        hosts = workspace.hosts()
        control = _measuring(transcript, stop, stops=self.stop_partitions, on_busy_host=self.on_busy_host)
        request = TuneRequest(dry_run=self.dry_run, on_busy_host=self.on_busy_host)
        result = tune_components(hosts, request, control, WatchedTuning(transcript.say))
        for sentence in manifest_changes(result):
            transcript.message(sentence)
        transcript.findings(result.findings, hosts.manifest.sources)
        transcript.say(tuned_text(result))
        return _ending(transcript, result.findings, stopped=result.run.ending == "stopped")


class ProveAction(Action):
    """Run all components in the applied layout."""

    load_host: bool = False
    without_load: bool = False

    def command(self) -> RecommendedCommand:
        """Return `rarms prove`."""
        return command("prove", load_host=self.load_host, without_load=self.without_load)

    def run(self, workspace: Workspace, transcript: Transcript, stop: StopSignal) -> Ending:
        """Prove; where it is stopped, the loads that had ended are recorded."""
        if not (self.load_host or self.without_load):
            raise RequestError("A proof loads the hosts fully. Check the box to confirm, or prove without load.")
        hosts = workspace.hosts()
        request = ProveRequest(load_host=self.load_host, without_load=self.without_load)
        outcome = prove_layout(hosts, request, Control(reporter=transcript, stop=stop))
        if outcome.stopped:
            if outcome.proofs:
                transcript.say(proof_text(outcome))
            transcript.message(stopped_proof(outcome, request))
            return "stopped"
        transcript.findings(outcome.findings, hosts.manifest.sources)
        transcript.say(proof_text(outcome))
        if outcome.not_proven:
            transcript.message(f"Not proven, because they run on other hosts: {in_a_row(outcome.not_proven)}.")
        return "failed" if outcome.findings else "done"


class PlanAction(Action):
    """Work out what would change, and keep that as the plan of the page."""

    changes: ClassVar[bool] = False
    purpose: ClassVar[Purpose] = Purpose.APPLY

    def command(self) -> RecommendedCommand:
        """Return `rarms plan`."""
        return PLAN

    def run(self, workspace: Workspace, transcript: Transcript, stop: StopSignal) -> Ending:  # noqa: ARG002 - it is over soon
        """Plan; the page shows the plan itself."""
        workspace.plan = None
        hosts = workspace.hosts()
        plan = make_plan(hosts, replace(plan_request(hosts), purpose=self.purpose))
        workspace.does = START if self.purpose is Purpose.START else APPLY
        workspace.scripts = scripts_since(plan, dict(last_runs(hosts)))
        workspace.plan = plan
        transcript.message(f"Plan {plan.id} is ready.")
        return "done"


class PlanStartAction(PlanAction):
    """Work out what starts what was stopped, and ends what a killed measurement left."""

    purpose: ClassVar[Purpose] = Purpose.START

    def command(self) -> RecommendedCommand:
        """Return `rarms start`, which shows its plan and asks."""
        return START


class ApplyAction(Action):
    """Do what the plan of the page says."""

    plan: str  # its id, as the page showed it
    application: str  # its name, typed
    does: Literal["apply", "start"] = "apply"  # verb of the command that makes such a plan

    def command(self) -> RecommendedCommand:
        """Return `rarms apply`, or what else shows such a plan and asks."""
        return command(self.does)

    def run(self, workspace: Workspace, transcript: Transcript, stop: StopSignal) -> Ending:
        """Apply exactly the plan that was shown."""
        plan = workspace.plan
        if plan is None or plan.id != self.plan:
            raise RequestError(f"A newer plan than {self.plan} exists. Plan again.")
        _refuse_other_name(self.application, plan.application)
        source = workspace.source
        refuse_contradiction(plan, source)
        transcript.findings(changed_manifest(plan, source))
        workspace.plan = None  # a plan is used once
        control = Control(reporter=transcript, stop=stop)
        return _report_end(apply(plan, folder=workspace.hosts().folder, waits=WAITS, control=control), transcript)


class FinishAction(Action):
    """Finish what an earlier run left on the hosts."""

    application: str

    def command(self) -> RecommendedCommand:
        """Return `rarms apply`, which finishes first."""
        return APPLY

    def run(self, workspace: Workspace, transcript: Transcript, stop: StopSignal) -> Ending:
        """Finish it, from its journal."""
        hosts = workspace.hosts()
        _refuse_other_name(self.application, hosts.system.application.name)
        live = tuple(hosts.open(name) for name in hosts.chosen)
        control = Control(reporter=transcript, stop=stop)
        finished = finish_runs(live, waits=WAITS, control=control, needs_key=hosts.system.policy.signed_plans)
        return _report_end(finished or RunReport(ending=RunEnding.NOTHING), transcript)


class UndoAction(Action):
    """Undo the last apply."""

    application: str

    def command(self) -> RecommendedCommand:
        """Return `rarms undo`."""
        return command("undo")

    def run(self, workspace: Workspace, transcript: Transcript, stop: StopSignal) -> Ending:
        """Undo, the last step first."""
        hosts = workspace.hosts()
        _refuse_other_name(self.application, hosts.system.application.name)
        control = Control(reporter=transcript, stop=stop)
        return _report_end(undo_applies(last_applies(hosts), waits=WAITS, control=control), transcript)


class UndoPreviewAction(Action):
    """Show what an undo would do."""

    changes: ClassVar[bool] = False

    def command(self) -> RecommendedCommand:
        """Return `rarms undo`, which asks before it does anything."""
        return command("undo")

    def run(self, workspace: Workspace, transcript: Transcript, stop: StopSignal) -> Ending:  # noqa: ARG002 - it is over soon
        """Look, and change nothing."""
        for undo in preview(last_applies(workspace.hosts())):
            transcript.say(undo_text(undo))
            transcript.findings(undo.findings)
        return "shown"


def _refuse_other_name(typed: str, name: str) -> None:
    if typed != name:
        raise RequestError(f"{quoted(typed)} is not the application's name. Type {quoted(name)}.")


def _ending(transcript: Transcript, findings: tuple[Diagnostic, ...], *, stopped: bool) -> Ending:
    """Return the ending of a measurement or a search, after reporting a stop."""
    if stopped:
        transcript.message(STOPPED)
        return "stopped"
    return "failed" if has_errors(findings) else "done"


def _report_end(report: RunReport, transcript: Transcript) -> Ending:
    transcript.findings(report.findings)
    transcript.say(run_text(report))
    match report.ending:
        case RunEnding.DONE | RunEnding.NOTHING:
            return "done"
        case RunEnding.INTERRUPTED:
            return "stopped"
        case RunEnding.REFUSED | RunEnding.FAILED:
            return "failed"
        case _:
            assert_never(report.ending)


ACTIONS: Mapping[str, type[Action]] = MappingProxyType(
    {
        "measure": MeasureAction,
        "tune": TuneAction,
        "prove": ProveAction,
        "plan": PlanAction,
        "plan-start": PlanStartAction,
        "apply": ApplyAction,
        "finish": FinishAction,
        "undo": UndoAction,
        "undo-preview": UndoPreviewAction,
    }
)
"""By the last part of the address that the page sends a body to."""
