"""What the manifest says of components and interfering loads, as the model's demands."""

from typing import assert_never

from rarms_iac.model.measurement import run_of
from rarms_iac.model.system import Browser, BusyLoop, CommandLoad, Component, Interference, Periodic
from rarms_iac.providers.simulated.scheduling.values import (
    ORDINARY,
    Arrival,
    Browsers,
    BusyLoops,
    Demand,
    Every,
    Load,
    OneAfterAnother,
    Programs,
)


class NoDemand(ValueError):
    """The component has no `simulation`, so nobody knows what it asks of a simulated host."""

    def __init__(self, component: str) -> None:
        super().__init__(f"{component} has no `simulation`: say there what a job demands on a simulated host")
        self.component = component


def demand_of(component: Component, priority: int = ORDINARY) -> Demand:
    """The component's demand; its threads run at this priority.

    Raises:
        NoDemand: it has no `simulation`.
    """
    asked = component.simulation
    if asked is None:
        raise NoDemand(component.name)
    return Demand(
        component=component.name,
        work_ms=float(asked.work),
        blocked_ms=float(asked.blocked),
        varies=float(asked.varies),
        threads=asked.threads,
        arrival=_arrival(component),
        success_within_ms=None if asked.success_within is None else float(asked.success_within),
        timeout_ms=float(run_of(component).timeout),
        priority=priority,
    )


def load_of(interference: Interference) -> Load:
    """The load that interferes. Of another program nothing is known, so it is taken for one that never waits."""
    match interference:
        case BusyLoop(threads=threads):
            return BusyLoops(threads=threads)
        case Browser(instances=instances):
            return Browsers(instances=instances)
        case CommandLoad(instances=instances):
            return Programs(instances=instances)
        case _:
            assert_never(interference)


def _arrival(component: Component) -> Arrival:
    if component.run is not None and isinstance(component.run.arrival, Periodic):
        return Every(period_ms=float(component.run.arrival.period))
    return OneAfterAnother()
