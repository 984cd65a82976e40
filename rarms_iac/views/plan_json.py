"""A plan as programs read it."""

from rarms_iac.model.changes import Change
from rarms_iac.model.plan import HostPlan, Plan, Step, Totals
from rarms_iac.views.changes import count
from rarms_iac.views.json_output import json_of
from rarms_iac.views.output.common import output_of
from rarms_iac.views.output.plan import (
    ChangeOutput,
    CountsOutput,
    HeldBackOutput,
    HostOutput,
    PlacementOutput,
    PlanOutput,
    StepOutput,
    ThreadsOutput,
    TotalsOutput,
    UndoOutput,
)


def plan_json(plan: Plan) -> str:
    """The whole plan, scripts left out."""
    return json_of(plan_output(plan))


def plan_output(plan: Plan) -> PlanOutput:
    """The same as values."""
    counts = count(change for part in plan.hosts for change in part.changes)
    held = sum(len(part.held_back) for part in plan.hosts)
    return PlanOutput(
        plan=plan.id,
        application=plan.application,
        purpose=plan.purpose.value,
        manifest=plan.manifest,
        today=plan.today,
        max_disruption=plan.max_disruption.value,
        has_changes=plan.has_changes,
        counts=CountsOutput(**counts, held_back=held),
        hosts=tuple(map(_host, plan.hosts)),
        findings=plan.findings,
        accepted=plan.accepted,
        placement=None if plan.placement is None else output_of(PlacementOutput, plan.placement),
    )


def _host(part: HostPlan) -> HostOutput:
    return HostOutput(
        name=part.host.name,
        provider=part.facts.provider.value,
        logical_processors=part.facts.logical_processors,
        memory=part.facts.memory,
        serial=part.serial,
        changes=tuple(change_output(change, part) for change in part.changes),
        steps=tuple(map(_step, part.steps)),
        held_back=tuple(
            HeldBackOutput(change=change_output(held.change, part), why=held.why) for held in part.held_back
        ),
        unused=part.unused,
        stopped=part.stopped,
        unchanged=part.unchanged,
        totals=None if part.totals is None else _totals(part.totals, part),
        threads=tuple(output_of(ThreadsOutput, thread) for thread in part.threads),
    )


def _totals(totals: Totals, part: HostPlan) -> TotalsOutput:
    return TotalsOutput(
        logical_processors=part.facts.logical_processors,
        reserved_processors=totals.percent / 100,
        reserved_percent=totals.percent,
        reserved_memory=totals.memory,
        unmanaged_percent=totals.others_percent,
        unmanaged_memory=totals.others_memory,
        idle_percent=totals.idle_percent,
        idle_memory=totals.idle_memory,
    )


def change_output(change: Change, part: HostPlan | None = None) -> ChangeOutput:
    """One change, with the attributes that it touches; `part` knows which components its partition holds."""
    return ChangeOutput(
        address=str(change.address),
        action=change.action,
        disruption=change.disruption.value,
        reason=change.reason.message,
        place=change.reason.place,
        components=part.components.get(change.address.partition, ()) if part is not None else (),
        reserved_processors=None if change.reserved_lp is None else float(change.reserved_lp),
        attributes=change.attributes,
    )


def _step(step: Step) -> StepOutput:
    return output_of(
        StepOutput,
        step,
        address=str(step.address),
        operation=step.operation.kind,
        undo=UndoOutput(level=step.undo.level.value, message=step.undo.message),
    )
