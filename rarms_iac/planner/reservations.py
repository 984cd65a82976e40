"""Where a reservation comes from: the manifest now, a data log or an experiment later (DESIGN section 2)."""

from collections.abc import Hashable
from dataclasses import dataclass
from fractions import Fraction
from typing import Protocol

from rarms_iac.model.quantities import CpuAmount, LogicalProcessors, ProcessorTime, in_processors
from rarms_iac.model.system import Component, Host, Measured


@dataclass(frozen=True, slots=True, kw_only=True)
class NotMeasured:
    """There is no answer for these components."""

    components: tuple[str, ...]


class ReservationSource(Protocol):
    """Answers what components need, together in one partition, on a host."""

    def reservation(self, members: tuple[Component, ...], host: Host) -> CpuAmount | NotMeasured:
        """The reservation with which every APT of the members holds. Quick; the same question has the same answer."""
        ...

    def depends_on(self, host: Host) -> Hashable:
        """What of a host the answers depend on: hosts for which this is equal have the same answers."""
        ...


@dataclass(frozen=True, slots=True)
class FixedReservations:
    """Only what the manifest fixes: the sum of the members' reserves.

    A component without APT and without reserve needs none. One with an APT and without a reserve is to be measured.
    """

    def reservation(self, members: tuple[Component, ...], host: Host) -> CpuAmount | NotMeasured:
        """The members' fixed reserves in LPs of this host, added up."""
        total = Fraction(0)
        unknown = []
        for one in members:
            match one.cpu.reserve:
                case Measured.MEASURED:
                    unknown.append(one.name)
                case None:
                    unknown += [one.name] if one.apt else []
                case amount:
                    total += in_processors(amount, host.logical_processors)
        return NotMeasured(components=tuple(unknown)) if unknown else ProcessorTime(LogicalProcessors(total))

    def depends_on(self, host: Host) -> Hashable:
        """A share of a host is of its logical processors; nothing else matters."""
        return host.logical_processors
