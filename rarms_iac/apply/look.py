"""`rarms drift`: who moved, the hosts or the manifest? It is given States, not hosts, so it can only read."""

from collections.abc import Mapping
from dataclasses import dataclass
from types import MappingProxyType

from rarms_iac.apply.wanted import FIXED, wanted
from rarms_iac.diff.drift import Drifted, drift
from rarms_iac.model.diagnostics import Diagnostic, Places
from rarms_iac.model.state import State
from rarms_iac.model.system import Disruption, System
from rarms_iac.planner.reservations import ReservationSource


@dataclass(frozen=True, slots=True, kw_only=True)
class HostDrift:
    """What drifted on a host, by address."""

    host: str
    drifted: tuple[Drifted, ...]


def look(
    system: System,
    observed: Mapping[str, State],
    places: Places,
    limit: Disruption,
    left: Mapping[str, frozenset[str] | None] = MappingProxyType({}),
    reservations: ReservationSource = FIXED,
) -> tuple[tuple[HostDrift, ...], tuple[Diagnostic, ...]]:
    """The drift of every observed host, by name, and what the planner found. Without a layout nothing is compared.

    `left` says by host which partitions the last run left there, where that is known.
    """
    wishes = wanted(system, observed, places, limit, reservations)
    application = system.application.name
    drifts = tuple(
        HostDrift(host=name, drifted=drift(wish.desired, wish.observed, application, wish.unused, left.get(name)))
        for name, wish in wishes.hosts.items()
    )
    return drifts, wishes.findings
