"""Checks verdicts on real runs of the Linux evaluation by measuring again: by the other runs of the same setting."""

import random
from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from fractions import Fraction
from math import exp, log
from statistics import fmean

from laboratory.linux.evaluation import JUDGED
from laboratory.linux.experiments import Log, value_of
from rarms_iac.model.outcomes import Met, Missed
from rarms_iac.model.series import Series
from rarms_iac.model.system import AtLeast, AtMost, Component, run_of
from rarms_iac.statistics.verdicts import judge

DRAWS = 5
"""Of an index of a run."""

NEAREST, FARTHEST = 1.5, 4.0
"""How many times too large or too small a drawn threshold is at least, and at most."""


@dataclass(frozen=True, slots=True, kw_only=True)
class VerdictCount:
    """How verdicts on real runs did."""

    judged: int
    given: int
    wrong: int


def count_verdicts(record: Log, components: Mapping[str, Component]) -> VerdictCount:
    """Judge every run by thresholds around what the other runs of the same setting showed."""
    outcomes = [outcome for component in components.values() for outcome in _verdicts_on(record, component)]
    given = [outcome for outcome in outcomes if outcome is not None]
    return VerdictCount(judged=len(outcomes), given=len(given), wrong=given.count(False))


def _verdicts_on(record: Log, component: Component) -> Iterator[bool | None]:
    """Whether each verdict was right; None: there was none."""
    for reserve in JUDGED:
        runs = record.runs("long", component.name, reserve)
        for number, series in enumerate(runs if len(runs) > 1 else []):
            others = [run for other, run in enumerate(runs) if other != number]
            for index in component.apt:
                truth = fmean(value_of(index, run) for run in others)
                chance = random.Random(f"{component.name}/{reserve}/{number}/{index}")
                for _ in range(DRAWS):
                    factor = exp(chance.uniform(log(NEAREST), log(FARTHEST)))
                    # No rate is above 100 %.
                    for limit in (truth / factor, truth * factor)[: 1 if index == "success_rate" else 2]:
                        yield _is_right(component, index, series, truth, limit)


def _is_right(component: Component, index: str, series: Series, truth: float, limit: float) -> bool | None:
    at_most = isinstance(component.apt[index], AtMost)
    threshold = (AtMost if at_most else AtLeast)(value=Fraction(limit).limit_denominator(10**6))
    match judge(series, {index: threshold}, run_of(component)):
        case Met():
            return truth <= limit if at_most else truth >= limit
        case Missed():
            return truth > limit if at_most else truth < limit
        case _:
            return None
