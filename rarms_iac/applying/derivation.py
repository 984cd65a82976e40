"""What a plan that was read says, made again of its changes and of what it found: a seal has no key.

Steps with their titles, order, undo and disruption follow from the changes and the basis, scripts from the steps, and
totals from the changes. What else a plan says (reasons, places, findings) is the words of its file.
"""

from collections.abc import Iterator

from rarms_iac.applying.scripts import edited_script
from rarms_iac.applying.state_after import partitions_after, promised
from rarms_iac.diff.disruption import disruption_of_task, disruption_of_update
from rarms_iac.diff.drift import PARTITION_PREFIX, part_digests
from rarms_iac.diff.hold_back import hold_back
from rarms_iac.diff.order import Deadlock, order
from rarms_iac.diff.steps import plan_changes
from rarms_iac.model.capacity import capacity_of
from rarms_iac.model.changes import Change, Create, Delete, Release, Update
from rarms_iac.model.plan import HostPlan, Plan
from rarms_iac.model.plan_basis import PlanBasis
from rarms_iac.model.state import Partition, State
from rarms_iac.model.system import Disruption

_UNMADE = (ArithmeticError, AssertionError, LookupError, ValueError, AttributeError, TypeError)
"""What making steps of a plan's changes raises where no plan of ours has such changes."""


def find_forgery(plan: Plan) -> str | None:
    """Find what of a plan does not follow from what it does.

    Args:
        plan: as it was read; its seal and id fit.

    Returns:
        The first such thing, as the subject of a sentence with its verb; None: all of it follows.
    """
    for part in plan.hosts:
        try:
            problem = next(_forgeries(plan, part), None)
        except _UNMADE:
            # NOTE: the plan's own steps were made when it was made; what cannot be made was put there since.
            problem = f"no steps can be made of the changes of {part.host.name}"
        if problem is not None:
            return problem
    if name := edited_script(plan):
        return f"its script {name} is not what its steps make"
    return None


def _forgeries(plan: Plan, part: HostPlan) -> Iterator[str]:
    basis = part.basis
    if basis is None:
        yield f"it has no record from which the steps of {part.host.name} can be made again"
        return
    if basis.context.facts != part.facts:
        yield f"the facts of {part.host.name} are not those that its steps are made for"
    if basis.budget.max_disruption is not plan.max_disruption:
        yield "its limit of disruption is not that of its steps"
    if basis.budget.capacity != capacity_of(part.host, part.facts):
        yield f"the capacity of {part.host.name} is not that of its facts and settings"
    shared = (basis.context.criticality, basis.context.graces, basis.context.forces)
    if shared != (basis.budget.criticality, basis.budget.graces, basis.budget.forces):
        yield f"the order of steps on {part.host.name} is made for other partitions than its steps"
    every = sorted((*part.changes, *(held.change for held in part.held_back)), key=lambda change: change.address)
    held_back = hold_back(every, basis.budget)
    if (held_back.allowed, held_back.held_back) != (part.changes, part.held_back):
        yield f"what is held back on {part.host.name} does not follow from its changes and its limit of disruption"
    ordered = order(plan_changes(part.changes, basis.context), basis.budget)
    made = () if isinstance(ordered, Deadlock) else ordered.steps
    for number, (own, derived) in enumerate(zip(part.steps, made, strict=False), start=1):
        if own != derived:
            yield f"step {number} of {part.host.name}, `{own.title}`, is not what its changes make"
    if len(part.steps) != len(made):
        yield f"{part.host.name} has {len(part.steps)} steps, and its changes make {len(made)}"
    for change in part.changes:
        if change.disruption not in _disruptions(change, basis):
            yield f"the disruption of {change.address} is not what its change makes"
    machines = tuple(machine for _, machine in sorted(basis.budget.managed.items()))
    before = State(facts=part.facts, partitions=machines, serials={plan.application: part.serial}, disks=basis.disks)
    yield from _unobserved(plan, part, before)
    own_after = partitions_after(before, plan.application, part.changes)
    if part.totals != promised(own_after, basis.others, basis.named):
        yield f"the totals of {part.host.name} are not those of its changes"


def _unobserved(plan: Plan, part: HostPlan, before: State) -> Iterator[str]:
    """What is said of the host and its machines before the first step, and is not what the plan's digests are of.

    `rarms apply` compares the digests with the host, so a plan with digests of something else is refused there.
    """
    digests = part_digests(before, plan.application)
    named = {name for name in part.digests if name.startswith(PARTITION_PREFIX)}
    for name in sorted(digests.keys() | named):
        if digests.get(name) != part.digests.get(name):
            yield f"{name} is not as its digest says on {part.host.name}"
    machines = {machine.id: machine for machine in before.partitions}
    for change in part.changes:
        match change:
            case Update(before=Partition() as own) | Delete(before=Partition() as own) | Release(before=own):
                if machines.get(own.id) != own:
                    yield f"{change.address} is not before its change as it was on {part.host.name}"
            case _:
                pass


def _disruptions(change: Change, basis: PlanBasis) -> frozenset[Disruption]:
    """What a change may disturb, by what it changes."""
    match change:
        case Update(before=Partition() as before, after=Partition() as after):
            stops = before.settings.running and not after.settings.running
            requested = Disruption.PARTITION_STOP if stops else Disruption.LIVE
            is_requested = before.settings.running is not after.settings.running
            computed = disruption_of_update(before, after.settings, basis.context)
            return frozenset({computed, requested} if is_requested else {computed})
        case Delete(before=Partition(id=machine)):
            loses_nothing = machine in basis.context.restorable
            return frozenset({Disruption.REMOVAL, *({Disruption.PARTITION_STOP} if loses_nothing else ())})
        case Create(after=Partition()):
            return frozenset({Disruption.LIVE})
        case _ if change.address.task:
            return frozenset({disruption_of_task(change.address.partition)})
        case _:
            return frozenset({Disruption.LIVE, Disruption.HOST_RESTART})
