"""Machines that rarms does not manage are never changed, but what they get may be.

When all machines are busy, each gets its reserve, and what is left is shared by weight, processor by processor
(FACTS 1.1). A larger reserve or weight of ours leaves less for the others. While the host has idle time nobody loses.
"""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from fractions import Fraction

from rarms_iac.apply.review.reviewed import Reviewed
from rarms_iac.model.diagnostics import Diagnostic, Finding, Severity
from rarms_iac.model.plan import Purpose
from rarms_iac.model.state import Partition, PartitionSettings

FINDING = Finding(code="RARMS223", severity=Severity.WARNING, summary="A machine that is not managed gets less")


def review(part: Reviewed) -> Iterator[Diagnostic]:
    """Tells once a host of running machines of others whose share of a busy host shrinks by the plan."""
    if part.purpose in {Purpose.IMPORT, Purpose.RELEASE}:
        return  # a mark is written or erased, and nobody's share changes
    others = [
        partition
        for partition in part.observed.partitions
        if partition.settings.running and not part.is_ours(partition)
    ]
    strangers = [other.settings for other in others]
    before = _running(
        [*strangers, *(partition.settings for partition in part.observed.of(part.application).partitions)]
    )
    after = _running([*strangers, *part.settings_after()])
    available = part.observed.facts.logical_processors
    shares = [
        (other, share(other.settings, before, available), share(other.settings, after, available)) for other in others
    ]
    if losers := [_Loser(machine=partition, old=old, new=new) for partition, old, new in shares if new < old]:
        yield _told(part, losers)


@dataclass(frozen=True, slots=True, kw_only=True)
class _Loser:
    """A machine and the LPs that it gets before and after."""

    machine: Partition
    old: Fraction
    new: Fraction

    def __str__(self) -> str:
        settings = self.machine.settings
        return (
            f'"{settings.name}" ({self.machine.id[:8]}) about {float(self.old):.2f} -> {float(self.new):.2f} LP, '
            f"{settings.reserve * settings.processors / 100:.2f} LP reserved"
        )


def _running(machines: Sequence[PartitionSettings]) -> list[PartitionSettings]:
    return [machine for machine in machines if machine.running]


def share(settings: PartitionSettings, running: Sequence[PartitionSettings], logical_processors: int) -> Fraction:
    """LPs that a machine gets while all that run are busy: its reserve, and by weight what no reserve takes."""
    reserved = Fraction(sum(other.reserve * other.processors for other in running), 100)
    weights = max(1, sum(other.weight * other.processors for other in running))
    left = max(Fraction(0), logical_processors - reserved)
    own = Fraction(settings.reserve * settings.processors, 100) + left * settings.weight * settings.processors / weights
    return min(own, Fraction(settings.limit * settings.processors, 100))


def _told(part: Reviewed, losers: Sequence[_Loser]) -> Diagnostic:
    host = part.plan.host.name
    return FINDING.at(
        None,
        f"Machines on {host} that {part.application} does not manage stay as they are, and get less while all are "
        f"busy: {'; '.join(map(str, losers))}.",
        "If one has to answer in time, give it a reserve first, or take it in: `rarms import`.",
        address=f"host/{host}",
    )
