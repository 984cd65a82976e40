"""A plan as programs read it."""

from collections.abc import Mapping
from dataclasses import fields
from typing import Literal, assert_never

from rarms_iac.model.changes import Adopt, Change, Create, Delete, Release, Resource, Update
from rarms_iac.model.plan import HostPlan, Plan, Step, Totals
from rarms_iac.model.state import Partition, Responsiveness, TaskClass
from rarms_iac.views.changes import count, forced_by, reserved_after, symbol
from rarms_iac.views.output.common import as_json, output_of
from rarms_iac.views.output.plan import (
    AttributeOutput,
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
    Value,
)

ACTIONS: Mapping[str, Literal["create", "update", "replace", "delete", "adopt", "release"]] = {
    "+": "create",
    "~": "update",
    "-/+": "replace",
    "-": "delete",
    ">": "adopt",
    "<": "release",
}


def plan_json(plan: Plan) -> str:
    """The whole plan, scripts left out."""
    return as_json(plan_output(plan))


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
    before, after = _sides(change)
    reserved = reserved_after(change)
    return ChangeOutput(
        address=str(change.address),
        action=ACTIONS[symbol(change)],
        disruption=change.disruption.value,
        reason=change.reason.message,
        place=change.reason.place,
        components=part.components.get(change.address.partition, ()) if part is not None else (),
        reserved_processors=None if reserved is None else float(reserved),
        attributes=tuple(
            AttributeOutput(name=name, before=before.get(name), after=after.get(name), forces=forced_by(change, name))
            for name in dict.fromkeys([*before, *after])
            if before.get(name) != after.get(name)
        ),
    )


def _sides(change: Change) -> tuple[Mapping[str, Value], Mapping[str, Value]]:
    match change:
        case Create(after=after):
            return {}, raw(after)
        case Delete(before=before):
            return raw(before), {}
        case Update(before=before, after=after):
            return raw(before), raw(after)
        case Adopt(before=before, after=after) | Release(before=before, after=after):
            return {"mark": _mark(before)}, {"mark": _mark(after)}
        case _:
            assert_never(change)


def _mark(partition: Partition) -> Value:
    return f"{partition.mark.application}/{partition.mark.name}" if partition.mark else None


def raw(resource: Resource) -> Mapping[str, Value]:
    """A resource's attributes as numbers and words; registry values as `dword:5`, which says their type."""
    match resource:
        case Partition(settings=settings):
            return {field.name: _plain(getattr(settings, field.name)) for field in fields(settings)}
        case TaskClass(values=values) | Responsiveness(values=values):
            return {name: f"{value.kind.value}:{value.data}" for name, value in sorted(values.items())}
        case _:
            assert_never(resource)


def _plain(value: object) -> Value:
    """An enumeration is a text already; its member would be written with its class."""
    if isinstance(value, bool | int):
        return value
    return str(value)


def _step(step: Step) -> StepOutput:
    return output_of(
        StepOutput,
        step,
        address=str(step.address),
        operation=step.operation.kind,
        undo=UndoOutput(level=step.undo.level.value, message=step.undo.message),
    )
