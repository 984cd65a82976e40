"""The paper's experiments on the simulated scheduler, with the delivery robot's own parameters.

What differs between the figures is what the paper varied: reserves, and how much interferes. Nothing else.
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from datetime import UTC, datetime
from itertools import islice
from statistics import mean

from rarms_iac.manifest.load import load_system
from rarms_iac.model.loads import Browser, BusyLoop
from rarms_iac.model.setting import P2_WEIGHT
from rarms_iac.model.system import System
from rarms_iac.providers.simulated.measuring import demand_of
from rarms_iac.providers.simulated.scheduling.machine import (
    IDLE,
    ORDINARY,
    QUIET_INTERRUPTS,
    JobDemand,
    JobDone,
    ModelLoad,
    ModelMachine,
    TracePiece,
    VirtualMachine,
)
from rarms_iac.providers.simulated.scheduling.simulation import SchedulerSimulation
from rarms_iac.storage.shipped import shipped

FDP, SRP, VSP, PPP = "face-detection", "speech-recognition", "video-streaming", "path-planning"
LPS = 2  # Table 1: Core 2 Duo
MEMORY_MIB = 512.0  # Table 1: what each partition has
HOST_MEMORY_MIB = 4096.0
RESERVES = tuple(range(10, 101, 10))
PAIRS = ((50, 50), (75, 25), (75, 0))
BROWSERS = (0, 1, 2, 5, 10)
PRIORITIES = {FDP: 30, SRP: 31}  # Fig. 3's; a component without a task class has the ordinary priority


@dataclass(frozen=True, slots=True, kw_only=True)
class Loaded:
    """One point of Fig. 3: every component alone with the browsers in one operating system."""

    browsers: int
    utilisation: float  # per cent of all LPs that the browsers use when nothing else runs
    response_ms: dict[str, float]  # by component
    success_rate: dict[str, float]  # by component, per cent
    throughput: dict[str, float]  # by component, successes a second


def the_robot() -> System:
    """Return the delivery robot as it is shipped."""
    path = shipped("manifests/delivery-robot/rarms.yaml")
    loaded = load_system(str(path), today=datetime.now(tz=UTC).date())
    if loaded.system is None:
        raise ValueError(f"{path} cannot be read: {loaded.diagnostics}")
    return loaded.system


def demands() -> dict[str, JobDemand]:
    """Return what the delivery robot's components ask for, at the priorities of Fig. 3."""
    return {
        name: demand_of(component, PRIORITIES.get(name, ORDINARY)) for name, component in the_robot().components.items()
    }


def bench(demand: JobDemand, reserves: tuple[float, float], load: ModelLoad | None) -> ModelMachine:
    """P1 with the component, P2 with what interferes; P1's and P2's reserves in per cent.

    P2 has the weight that it has in `rarms measure`: Table 1 has 100, with which P1 would get a third of what its own
    second VP leaves idle.
    """
    inside = () if load is None else (load,)
    return ModelMachine(
        lps=LPS,
        interrupts=QUIET_INTERRUPTS,
        machines=(
            VirtualMachine(name="P1", vps=LPS, reserve=reserves[0], memory_mib=MEMORY_MIB, components=(demand,)),
            VirtualMachine(
                name="P2", vps=LPS, reserve=reserves[1], weight=P2_WEIGHT, memory_mib=MEMORY_MIB, loads=inside
            ),
        ),
    )


def mean_response(machine: ModelMachine, jobs: int, seeds: Sequence[int]) -> float:
    """Over the first jobs of each seed."""
    return mean(job.response for seed in seeds for job in islice(SchedulerSimulation(machine, seed), jobs))


def figure_1(jobs: int, seeds: Sequence[int], reserves: Sequence[int] = RESERVES) -> dict[int, float]:
    """FDP's mean response time in ms by P1's reserve; P2 reserves the rest for a busy loop a VP."""
    fdp = demands()[FDP]
    return {cr: mean_response(bench(fdp, (cr, 100 - cr), BusyLoop()), jobs, seeds) for cr in reserves}


def figure_3(until_ms: float, seeds: Sequence[int], browsers: Sequence[int] = range(16)) -> list[Loaded]:
    """One operating system without partitions, and ever more browsers."""
    return [_loaded(number, until_ms, seeds) for number in browsers]


def figure_3_together(until_ms: float, seeds: Sequence[int], browsers: Sequence[int]) -> dict[int, dict[str, float]]:
    """Mean response times in ms, by component, of all four in one operating system, by browsers."""
    return {number: _together(number, until_ms, seeds) for number in browsers}


def figure_4(
    jobs: int, seeds: Sequence[int], browsers: Sequence[int] = BROWSERS
) -> dict[tuple[int, int], dict[int, float]]:
    """FDP's mean response time in ms by the browsers in P2, by the reserves of P1 and P2."""
    fdp = demands()[FDP]
    return {
        pair: {number: mean_response(bench(fdp, pair, playing(number)), jobs, seeds) for number in browsers}
        for pair in PAIRS
    }


def playing(browsers: int) -> ModelLoad | None:
    """So many browsers."""
    return Browser(instances=browsers) if browsers else None


def _loaded(browsers: int, until_ms: float, seeds: Sequence[int]) -> Loaded:
    asked = demands()
    jobs = {name: _jobs(asked[name], browsers, until_ms, seeds) for name in (FDP, SRP, VSP, PPP)}
    elapsed_s = until_ms * len(seeds) / 1000.0
    return Loaded(
        browsers=browsers,
        utilisation=_utilisation(browsers, until_ms, seeds),
        response_ms={name: mean(job.response for job in done) for name, done in jobs.items()},
        success_rate={name: 100.0 * mean(job.successful for job in done) for name, done in jobs.items()},
        throughput={name: sum(job.successful for job in done) / elapsed_s for name, done in jobs.items()},
    )


def _together(browsers: int, until_ms: float, seeds: Sequence[int]) -> dict[str, float]:
    machine, asked = _one_system(browsers), demands()
    inside = replace(machine.machines[0], components=tuple(asked[name] for name in (FDP, SRP, VSP, PPP)))
    filled = replace(machine, machines=(inside,))
    jobs = [job for seed in seeds for job in SchedulerSimulation(filled, seed, until_ms=until_ms)]
    return {name: mean(job.response for job in jobs if job.component == name) for name in (FDP, SRP, VSP, PPP)}


def _jobs(demand: JobDemand, browsers: int, until_ms: float, seeds: Sequence[int]) -> list[JobDone]:
    machine = _one_system(browsers)
    inside = replace(machine.machines[0], components=(demand,))
    return [
        job
        for seed in seeds
        for job in SchedulerSimulation(replace(machine, machines=(inside,)), seed, until_ms=until_ms)
    ]


def _utilisation(browsers: int, until_ms: float, seeds: Sequence[int]) -> float:
    busy = 0.0

    def count(piece: TracePiece) -> None:
        nonlocal busy
        if piece.ran != IDLE:
            busy += piece.ended - piece.began

    for seed in seeds:
        for _ in SchedulerSimulation(_one_system(browsers), seed, until_ms=until_ms, trace=count):
            pass
    return 100.0 * busy / (LPS * until_ms * len(seeds))


def _one_system(browsers: int) -> ModelMachine:
    load = playing(browsers)
    system = VirtualMachine(
        name="os", vps=LPS, memory_mib=HOST_MEMORY_MIB, loads=() if load is None else (load,), partitioned=False
    )
    return ModelMachine(lps=LPS, machines=(system,), interrupts=QUIET_INTERRUPTS)
