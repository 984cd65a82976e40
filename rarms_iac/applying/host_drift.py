"""`rarms drift`: did somebody change the hosts, or the manifest? It is given States, not hosts, so it can only read."""

from collections.abc import Mapping
from types import MappingProxyType

from rarms_iac.applying.goals import FIXED, goals_of
from rarms_iac.diff.drift import ResourceDrift, drift, drift_of_marks
from rarms_iac.model.diagnostics import Diagnostic, Places
from rarms_iac.model.state import State
from rarms_iac.model.system import Disruption, System
from rarms_iac.planner.reservations import ReservationSource


def drift_of_hosts(
    system: System,
    observed: Mapping[str, State],
    places: Places,
    limit: Disruption,
    last_runs: Mapping[str, frozenset[str] | None] = MappingProxyType({}),
    reservations: ReservationSource = FIXED,
) -> tuple[Mapping[str, tuple[ResourceDrift, ...]], tuple[Diagnostic, ...]]:
    """Find the drift of every observed host.

    Args:
        system: what the manifest says.
        observed: the hosts by name.
        places: the manifest's lines.
        limit: the largest disruption that the layout may ask for.
        last_runs: by host, the partitions that were there when its last run ended, where that is known.
        reservations: where reserves come from that the manifest does not fix.

    Returns:
        The drift by host name, and what the planner found. Where errors keep it from a layout, nobody knows what is
        wanted: then only what was changed on the hosts is told.
    """
    goals = goals_of(system, observed, places, limit, reservations)
    application = system.application.name
    if not goals.hosts:
        by_marks = {name: drift_of_marks(state, application, last_runs.get(name)) for name, state in observed.items()}
        return by_marks, goals.findings
    drifts = {
        name: drift(goal.desired, goal.observed, application, goal.rules.unused, last_runs.get(name))
        for name, goal in goals.hosts.items()
    }
    return drifts, goals.findings
