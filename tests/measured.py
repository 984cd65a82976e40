"""Seeded series for tests: what a component might show at one setting."""

import random
from collections.abc import Iterable

from rarms_iac.model.series import Sample, Series


def a_series(times: Iterable[float | None], *, successful: bool = True, component: str = "coi") -> Series:
    """Jobs one after the other with these response times in ms; None: no answer, after 1 ms."""
    samples: list[Sample] = []
    clock = 0.0
    for time in times:
        samples.append(Sample(began_ms=clock, response_ms=time, successful=successful and time is not None))
        clock += 1.0 if time is None else time
    return Series(component=component, samples=tuple(samples), elapsed_ms=clock)


def noisy(
    seed: int, mean: float, *, variation: float = 0.05, correlation: float = 0.0, count: int = 400
) -> list[float]:
    """A steady series about a mean: its coefficient of variation, and how each value depends on the one before."""
    chance = random.Random(seed)
    fresh = (1.0 - correlation**2) ** 0.5
    state, values = chance.gauss(0.0, 1.0), []
    for _ in range(count):
        values.append(mean * (1.0 + variation * state))
        state = correlation * state + fresh * chance.gauss(0.0, 1.0)
    return values
