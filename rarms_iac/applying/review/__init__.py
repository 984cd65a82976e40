"""Findings that a reviewer of a plan should see before it is applied.

In: one host's part of a plan with the host as observed (`ReviewedPlan`). Out: diagnostics. Begin at `review_plan`;
`changes` looks at single changes and steps, `host_effects` at the host as a whole.
"""

from collections.abc import Callable, Iterator

from rarms_iac.applying.review import changes, host_effects
from rarms_iac.applying.review.reviewed_plan import ReviewedPlan
from rarms_iac.model.diagnostics import Diagnostic

REVIEWS: tuple[Callable[[ReviewedPlan], Iterator[Diagnostic]], ...] = (
    changes.review_changes_from_outside,
    changes.review_images_and_switches,
    host_effects.review_script_placement,
    host_effects.review_smt,
    changes.review_restarts,
    changes.review_guests_that_are_not_asked,
    changes.review_memory,
    changes.review_raised_limits,
    changes.review_widened_limits,
    host_effects.review_unmanaged_machines,
    changes.review_removed_disks,
    changes.review_remaining_disks,
    changes.review_undo,
    changes.review_width,
    host_effects.review_task_classes,
)


def review_plan(part: ReviewedPlan) -> Iterator[Diagnostic]:
    """Find what a reviewer should see before the plan is applied to this host."""
    for review in REVIEWS:
        yield from review(part)
