"""Findings that a reviewer of a plan should see before it is applied.

In: the request, a host as it is and as it is to be, and its part of the plan. Out: diagnostics. Begin at
`review_plan`; `changes` looks at single changes and steps, `host_effects`
at the host as a whole.
"""

from collections.abc import Iterator

from rarms_iac.applying.plan_request import PlanRequest
from rarms_iac.applying.review import changes, host_effects
from rarms_iac.model.diagnostics import Diagnostic
from rarms_iac.model.plan import HostPlan
from rarms_iac.planner.desired import Desired


def review_plan(request: PlanRequest, desired: Desired, plan: HostPlan) -> Iterator[Diagnostic]:
    """Find what a reviewer should see before the plan is applied to this host."""
    yield from changes.review_changes_from_outside(request, desired, plan)
    yield from changes.review_images_and_switches(desired, plan)
    yield from changes.review_starts(plan)
    yield from changes.review_tied_machines(request.system, plan.changes)
    yield from host_effects.review_script_placement(desired.seen, plan.changes)
    yield from host_effects.review_smt(request, desired, plan)
    yield from changes.review_restarts(request, plan)
    yield from changes.review_guests_that_are_not_asked(desired, plan)
    yield from changes.review_memory(plan)
    yield from changes.review_raised_limits(request, desired)
    yield from host_effects.review_limits_without_effect(request, desired)
    yield from host_effects.review_unmanaged_machines(request, desired, plan)
    yield from changes.review_removed_disks(request, desired, plan)
    yield from changes.review_remaining_disks(request, desired, plan)
    yield from changes.review_undo(request, plan)
    yield from changes.review_width(desired, plan)
    yield from host_effects.review_numa_nodes(desired, plan)
    yield from host_effects.review_memory_left(desired.seen, plan.changes)
    yield from host_effects.review_cpu_groups(request, desired, plan)
    yield from host_effects.review_unequal_processors(request, desired)
    yield from host_effects.review_task_classes(request, desired, plan)
