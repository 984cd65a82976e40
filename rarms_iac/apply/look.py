"""`rarms drift`: who moved, the hosts or the manifest? It is given States, not hosts, so it can only read."""

from collections.abc import Mapping
from dataclasses import dataclass

from rarms_iac.apply.wanted import wanted
from rarms_iac.diff.drift import Drifted, drift
from rarms_iac.model.diagnostics import Diagnostic, Places
from rarms_iac.model.state import State
from rarms_iac.model.system import Disruption, System


@dataclass(frozen=True, slots=True, kw_only=True)
class HostDrift:
    """What drifted on a host, by address."""

    host: str
    drifted: tuple[Drifted, ...]


def look(
    system: System, observed: Mapping[str, State], places: Places, limit: Disruption
) -> tuple[tuple[HostDrift, ...], tuple[Diagnostic, ...]]:
    """The drift of every observed host, by name, and what the planner found. Without a layout nothing is compared."""
    wishes = wanted(system, observed, places, limit)
    application = system.application.name
    drifts = tuple(
        HostDrift(host=name, drifted=drift(wish.desired, wish.observed, application, wish.unused))
        for name, wish in wishes.hosts.items()
    )
    return drifts, wishes.findings
