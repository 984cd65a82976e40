"""What a component shows alone with the default loads, it keeps in a layout with them: 8 random layouts, or 40.

Each layout is drawn with its reservations. The threshold of each index is what the component shows alone with the load
that delays it most; in the layout no load may delay it more, but for noise. Only percentiles of job after job, each
shorter than 5 ms, do not always keep to it: they depend on how often a component waits.
"""

from collections.abc import Iterator, Sequence
from dataclasses import replace
from fractions import Fraction
from math import exp, log
from random import Random

from rarms_iac.measuring.partitions import MeasuringResources, load_share, processors_of_load, share_next_to_layout
from rarms_iac.model.capacity import Capacity, fits
from rarms_iac.model.claims import Claim
from rarms_iac.model.loads import DEFAULT_LOADS, LOADS_WITHOUT_ENTRY, load_parts
from rarms_iac.model.quantities import LEAST_MEMORY, Bytes, LogicalProcessors
from rarms_iac.model.setting import P2_WEIGHT, EnvironmentSetup
from rarms_iac.providers.simulated.measuring import model_load
from rarms_iac.providers.simulated.scheduling.machine import QUIET_INTERRUPTS, JobDemand, ModelMachine, VirtualMachine
from rarms_iac.providers.simulated.scheduling.simulation import SchedulerSimulation
from tests.effort import LONG

LAYOUTS = 40 if LONG else 8
LPS = 2
SETTLED_MS, UNTIL_MS = 2_500.0, 22_500.0
NOISE = 1.1
MOST_MISSED = 0.25
"""Of the layouts, in percentiles: 2 of the 8 miss, and 7 of the 40."""
SHORT_MS = 5.0
LEAST_JOBS = 300
INDEXES = (("mean", 0.0), ("p90", 0.9), ("p95", 0.95))


MEMORY = Bytes(16 * 2**30)


def draw(seed: int | str, lps: int = LPS) -> tuple[VirtualMachine, ...]:
    """Draw partitions that reserve 60 to 97 % of the host and fit it, each with a component of 0.5 to 100 ms."""
    chance = Random(f"layout/{seed}")
    capacity = Capacity(logical_processors=lps, processors=LogicalProcessors(Fraction(lps)), memory=MEMORY)
    while True:
        drawn = _draw(chance, lps)
        if fits(capacity, [Claim(processors=each.vps, reserve=int(each.reserve), memory=0) for each in drawn]):
            return drawn


def _draw(chance: Random, lps: int) -> tuple[VirtualMachine, ...]:
    parts = [chance.uniform(0.3, 1.0) for _ in range(chance.randint(2, 4))]
    reserved = 100 * lps * chance.uniform(0.6, 0.97)
    return tuple(
        _partition(chance, f"c{number}", reserved * part / sum(parts), lps) for number, part in enumerate(parts)
    )


def _partition(chance: Random, name: str, share: float, lps: int) -> VirtualMachine:
    vps = min(lps, chance.choice((1, 1, 1, 2)))
    threads = chance.choice((1, vps))
    reserve = max(2, min(95, int(share / vps)))
    work = exp(chance.uniform(log(0.5), log(100.0)))
    period = 100 * work * chance.choice((1.1, 1.3, 2.0, 4.0)) / reserve if chance.random() < 0.65 else None
    blocked = 0.0 if period else work * chance.choice((0.0, chance.uniform(0.0, 2.0)))
    varies = chance.choice((0, 2, 10, 30))
    demand = JobDemand(
        component=name, work_ms=work * threads, blocked_ms=blocked, varies=varies, threads=threads, period_ms=period
    )
    return VirtualMachine(name=name, vps=vps, reserve=reserve, components=(demand,))


def slowest(
    partitions: Sequence[VirtualMachine], seed: int, most_parts: int, lps: int = LPS
) -> dict[tuple[str, str], float]:
    """Return each index of each component with the load that delays it most, in ms."""
    found: dict[tuple[str, str], float] = {}
    for name in DEFAULT_LOADS:
        for component, times in responses(
            (*partitions, *load_of(name, partitions, most_parts, lps)), seed, lps
        ).items():
            for index, value in indexes(times):
                found[component, index] = max(value, found.get((component, index), 0.0))
    return found


def load_of(name: str, partitions: Sequence[VirtualMachine], most_parts: int, lps: int) -> Iterator[VirtualMachine]:
    """Yield the parts of P2 as they are next to P1, or next to the partitions of a layout."""
    load = LOADS_WITHOUT_ENTRY[name]
    most = min(most_parts, load_parts(load, lps))
    capacity = Capacity(logical_processors=lps, processors=LogicalProcessors(Fraction(lps)), memory=MEMORY)
    claims = tuple(Claim(processors=each.vps, reserve=int(each.reserve), memory=0) for each in partitions)
    room = MeasuringResources(capacity=capacity, claims=claims, shared_processors=capacity.processors)
    if len(partitions) == 1:
        [p1] = partitions
        setup = EnvironmentSetup(
            members=(p1.name,), interference=name, processors=p1.vps, memory=LEAST_MEMORY, limit=100, weight=100
        )
        room = replace(room, claims=())
        parts = processors_of_load(room, setup, load, most)
        share = load_share(room, setup, int(p1.reserve), parts)
        assert share is not None
    else:
        parts, share = share_next_to_layout(room, load, LEAST_MEMORY, most)
    for vps, (part, reserve) in zip(parts, share.reserves.items(), strict=True):
        loads = (model_load(load, reserve),)
        yield VirtualMachine(name=part, vps=vps, reserve=reserve, weight=P2_WEIGHT, loads=loads)


def responses(machines: tuple[VirtualMachine, ...], seed: int, lps: int = LPS) -> dict[str, list[float]]:
    host = ModelMachine(lps=lps, machines=machines, interrupts=QUIET_INTERRUPTS)
    times: dict[str, list[float]] = {}
    for job in SchedulerSimulation(host, seed, until_ms=UNTIL_MS):
        if job.began > SETTLED_MS:
            times.setdefault(job.component, []).append(job.response)
    return times


def indexes(times: Sequence[float]) -> Iterator[tuple[str, float]]:
    ordered = sorted(times)
    for index, share in INDEXES:
        yield index, ordered[int(share * len(ordered))] if share else sum(times) / len(times)


def missed(seed: int, most_parts: int) -> list[tuple[str, str]]:
    """List the indexes of components of more than a few jobs that are worse in the layout than alone."""
    layout = draw(seed)
    together = slowest(layout, seed + 1000, most_parts)
    alone = {key: value for each in layout for key, value in slowest([each], seed, most_parts).items()}
    many = {name for name, times in responses(layout, seed).items() if len(times) >= LEAST_JOBS}
    return [key for key, value in together.items() if key[0] in many and value > NOISE * alone[key]]


def test_what_holds_alone_holds_in_layouts() -> None:
    found = {seed: missed(seed, most_parts=3) for seed in range(LAYOUTS)}

    assert sum(map(bool, found.values())) <= LAYOUTS * MOST_MISSED, found
    assert all(depends_on_waits(seed, *key) for seed, keys in found.items() for key in keys), found


def depends_on_waits(seed: int, component: str, index: str) -> bool:
    """Whether a value is a percentile of job after job, each shorter than `SHORT_MS`."""
    [demand] = [each.components[0] for each in draw(seed) if each.name == component]
    return index != "mean" and demand.period_ms is None and demand.work_ms / demand.threads < SHORT_MS
