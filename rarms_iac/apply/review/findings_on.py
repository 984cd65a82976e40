"""All findings on one host's part of a plan."""

from collections.abc import Iterator

from rarms_iac.apply.review import (
    cannot_be_made,
    classes_above,
    disks_go,
    disks_stay,
    limit_below_reserve,
    limit_widens,
    memory_shrinks,
    no_place_by_size,
    not_undone,
    restarts,
    unmanaged_gets_less,
    wide_partition,
)
from rarms_iac.apply.review.reviewed import Reviewed
from rarms_iac.model.diagnostics import Diagnostic

REVIEWS = (
    cannot_be_made,
    no_place_by_size,
    restarts,
    memory_shrinks,
    limit_below_reserve,
    limit_widens,
    unmanaged_gets_less,
    disks_go,
    disks_stay,
    not_undone,
    wide_partition,
    classes_above,
)


def findings_on(part: Reviewed) -> Iterator[Diagnostic]:
    """What its reviewer should see before it is done."""
    for review in REVIEWS:
        yield from review.review(part)
