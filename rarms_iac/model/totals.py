"""Totals of hosts: what is reserved there and what is free, as plan, apply, status, measure and report show it.

Begin at `host_totals`, for one host, and `sum_of`, for several.
"""

from collections.abc import Iterable
from dataclasses import dataclass
from fractions import Fraction

from rarms_iac.model.capacity import capacity_of
from rarms_iac.model.claims import WHOLE, Claim, load_of
from rarms_iac.model.host import Host
from rarms_iac.model.output import Internal, output
from rarms_iac.model.state import HostFacts


@dataclass(frozen=True, slots=True, kw_only=True)
class Totals:
    """The sums of what a host has promised: to this application's partitions, and to all other machines."""

    percent: Internal[int]  # of one logical processor: 140 is 1.4 LP
    memory: int  # bytes
    others_percent: Internal[int] = 0
    others_memory: int = 0
    idle_percent: Internal[int] = 0  # of `percent`: to partitions that do not run
    idle_memory: int = 0  # of `memory`

    @output
    def reserved_lp(self) -> Fraction:
        """LPs that are promised to this application's partitions."""
        return Fraction(self.percent, WHOLE)

    @output
    def others_lp(self) -> Fraction:
        """LPs that are promised to all other machines."""
        return Fraction(self.others_percent, WHOLE)

    @output
    def idle_lp(self) -> Fraction:
        """LPs that are promised to those of this application's partitions that do not run; a part of `reserved_lp`."""
        return Fraction(self.idle_percent, WHOLE)


def totals_of(own: Iterable[Claim], others: Iterable[Claim] = (), idle: Iterable[Claim] = ()) -> Totals:
    """Add up what a host has promised.

    Args:
        own: the claims of the application's partitions that run, one each.
        others: the claims of all other machines, those of other applications included.
        idle: the claims of its partitions that do not run and keep what they reserve; in `own` they count nothing.

    Returns:
        The sums; `percent` and `memory` are of all of the application's partitions.
    """
    running, foreign, waiting = load_of(own), load_of(others), load_of(idle)
    return Totals(
        percent=running.percent + waiting.percent,
        memory=running.memory + waiting.memory,
        others_percent=foreign.percent,
        others_memory=foreign.memory,
        idle_percent=waiting.percent,
        idle_memory=waiting.memory,
    )


@dataclass(frozen=True, slots=True, kw_only=True)
class HostTotals:
    """The capacity and promises of hosts, in LPs and bytes; free capacity is negative where too much is promised."""

    host_lp: int  # all logical processors
    memory: int  # all memory, in bytes
    kept_lp: Fraction  # of `host_lp`: for the hosts themselves
    kept_memory: int
    promised: Totals

    @output
    def reserved_lp(self) -> Fraction:
        """LPs that the application's partitions are promised."""
        return self.promised.reserved_lp

    @output
    def unmanaged_lp(self) -> Fraction:
        """LPs that all other machines reserve."""
        return self.promised.others_lp

    @output
    def capacity_lp(self) -> Fraction:
        """LPs that the application's partitions may be promised: without what is kept and what others reserve."""
        return self.host_lp - self.kept_lp - self.unmanaged_lp

    @output
    def free_lp(self) -> Fraction:
        """LPs that are not promised."""
        return self.capacity_lp - self.reserved_lp

    @property
    def free_memory(self) -> int:
        """Bytes that are not promised."""
        return self.memory - self.kept_memory - self.promised.memory - self.promised.others_memory


def host_totals(host: Host, facts: HostFacts, promised: Totals) -> HostTotals:
    """Set what a host has promised against what it has.

    Args:
        promised: as `totals_of` adds it up.

    Returns:
        The host's totals.
    """
    capacity = capacity_of(host, facts)
    memory = min(int(host.memory), facts.memory)
    return HostTotals(
        host_lp=capacity.logical_processors,
        memory=memory,
        kept_lp=capacity.logical_processors - capacity.processors,
        kept_memory=memory - capacity.memory,
        promised=promised,
    )


def sum_of(totals: Iterable[HostTotals]) -> HostTotals:
    """Add up the totals of several hosts. What is free on all of them together need not fit a partition anywhere."""
    hosts = tuple(totals)
    promised = [host.promised for host in hosts]
    return HostTotals(
        host_lp=sum(host.host_lp for host in hosts),
        memory=sum(host.memory for host in hosts),
        kept_lp=sum((host.kept_lp for host in hosts), Fraction(0)),
        kept_memory=sum(host.kept_memory for host in hosts),
        promised=Totals(
            percent=sum(each.percent for each in promised),
            memory=sum(each.memory for each in promised),
            others_percent=sum(each.others_percent for each in promised),
            others_memory=sum(each.others_memory for each in promised),
            idle_percent=sum(each.idle_percent for each in promised),
            idle_memory=sum(each.idle_memory for each in promised),
        ),
    )
