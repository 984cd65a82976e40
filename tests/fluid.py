"""A scheduler model without a scheduler: a component's job takes its work over what its partition reserves.

For tests that are about measuring and not about scheduling: the answers are known by hand, and cost nothing.
"""

from collections.abc import Iterator
from contextlib import contextmanager
from random import Random

import pytest

from rarms_iac.providers.simulated.scheduling import simulation
from rarms_iac.providers.simulated.scheduling.machine import JobDone, ModelMachine


def fluid(machine: ModelMachine, seed: int) -> Iterator[JobDone]:
    """Jobs one after the other; each response is blocked + work / reserve, give or take what `varies` says."""
    random = Random(seed)
    clocks = {
        demand.component: (0.0, 0.0, demand, max(vm.reserve, 0.1) / 100)
        for vm in machine.machines
        for demand in vm.components
    }
    while True:
        name = min(clocks, key=lambda each: (clocks[each][0], each))
        now, cpu, demand, share = clocks[name]
        work = demand.work_ms * max(0.1, random.gauss(1, demand.varies / 100))
        response = demand.blocked_ms + work / share
        clocks[name] = (now + response, cpu + work, demand, share)
        within = demand.success_within_ms
        yield JobDone(name, now, response, within is None or response <= within, cpu + work)


@contextmanager
def without_scheduler() -> Iterator[None]:
    """Inside, simulated hosts of commands run the fluid model: for tests of files, questions and what is shown."""
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(simulation, "SchedulerSimulation", fluid)
        yield
