"""What `rarms measure` runs, the search and what makes it agree with a plan, next to halving and the paper's walk.

`python -m benchmarks.search [COMPONENTS]` takes so many components a noise level (1,000 unless said), spread
evenly over the shapes of `components.py`. An answer is *right* when it truly meets the APT within 1 % (a success rate:
1 point) and reserves at most 2 points above the least CR that meets an APT stricter by as much, or by what all samples
allowed can tell at the declared error: one point of precision, and one by which the search aims above the crossing.
"""

import math
import sys
from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from multiprocessing import Pool
from statistics import NormalDist, fmean

from benchmarks.components import ADVERSARIAL, NAMED, NOISES, UNSEEN, Bench, Truth, Walk, component, goal_of, walk
from benchmarks.timing import Figure, report
from rarms_iac.measuring.search import STRATEGIES
from rarms_iac.measuring.search.bracketing import MOST as MOST_SETTINGS
from rarms_iac.measuring.search.trials import Goal, judge_settings
from rarms_iac.measuring.strategies import Search, strategy_of
from rarms_iac.model.outcomes import Sufficient
from rarms_iac.model.series import MOST_SAMPLES
from rarms_iac.statistics.curves import curves_of, holds
from rarms_iac.statistics.distributions import LOOK_ERROR

COMPONENTS = 1000
TOLERANCE = 0.01
DEFAULT, HALVED, PAPER = "default", "bisection", "paper"
SHAPES = (*NAMED, *UNSEEN, *ADVERSARIAL)
MOST = 100  # the CR that the host can give
CLEAR = 2 * NormalDist().inv_cdf(1.0 - LOOK_ERROR)  # deviations of an index that its bound shows but for its error


@dataclass(frozen=True, slots=True, kw_only=True)
class Result:
    """How a strategy did on one component."""

    shape: str
    strategy: str
    settings: int
    samples: int
    found: bool
    certified: bool
    right: bool
    over: int  # points above the least CR that truly meets the APT


def results(task: tuple[str, int, float]) -> list[Result]:
    """All strategies on one component, which they measure in the same state of chance."""
    shape, seed, noise = task
    truth = component(shape, seed, noise)
    goal = goal_of(truth)
    bench = Bench(truth, goal)
    return [
        _result(truth, goal, name, walk(strategy_of(Search(strategy=name), goal, MOST), bench.measure))
        for name in STRATEGIES
    ]


def _result(truth: Truth, goal: Goal, strategy: str, done: Walk) -> Result:
    answer = done.end.reserve if isinstance(done.end, Sufficient) else 0
    passed, failed = _passed_and_failed(goal, done, strict=strategy != PAPER)
    return Result(
        shape=truth.shape,
        strategy=strategy,
        settings=len(done.settings),
        samples=done.samples,
        found=answer > 0,
        certified=answer in passed and (answer == 1 or any(answer - 3 <= reserve < answer for reserve in failed)),
        right=answer > 0
        and truth.meets(answer, stricter=-TOLERANCE)
        and answer <= truth.least(stricter=max(TOLERANCE, resolution(truth))) + 2,
        over=answer - truth.least(),
    )


def _passed_and_failed(goal: Goal, done: Walk, *, strict: bool) -> tuple[set[int], set[int]]:
    """Return the settings that passed and those that failed, by the curve that a plan uses or by verdicts.

    One without a steady state is neither.
    """
    reserves = {setting.reserve for setting in done.settings}
    apts = {member.name: member.apt for member in goal.members}
    curves = curves_of(done.settings, {member.name: member.run for member in goal.members}, apts)
    inconclusive = {each for curve, _ in curves for each in curve.inconclusive}
    if strict:
        passed = {each for each in reserves if all(holds(curve, apt, each) for curve, apt in curves)}
    else:
        passed = {trial.reserve for trial in judge_settings(done.settings, goal).trials if trial.passed}
    return passed, reserves - passed - inconclusive


def resolution(truth: Truth) -> float:
    """How far from the APT an index must lie to be told from it by all samples: a part of a mean, hundredths of all."""
    worth = MOST_SAMPLES * (1.0 - truth.correlation) / (1.0 + truth.correlation)
    if truth.limit_ms is None:
        return CLEAR * truth.noise / math.sqrt(worth)
    return CLEAR * math.sqrt(truth.apt * (100 - truth.apt) / worth) / 100


def percentile(numbers: Iterable[float], share: float) -> float:
    ordered = sorted(numbers)
    return ordered[math.ceil(share * len(ordered)) - 1]


def share_without(marks: Iterable[bool]) -> float:
    """Per cent of these that are not so."""
    return 100 * (1.0 - fmean(marks))


def figures(found: Sequence[Result]) -> list[Figure]:
    """Those of the default that have goals, and what stands next to them."""
    ours = [result for result in found if result.strategy == DEFAULT]
    answers = [result for result in ours if result.found]
    halved = fmean(result.samples for result in found if result.strategy == HALVED)
    rows: list[tuple[str, float, str, float | None]] = [
        ("not resolved", share_without(result.found for result in ours), "%", 2),
        ("answers without their certificate", share_without(answer.certified for answer in answers), "%", 0),
        ("not right", share_without(result.right for result in ours), "%", 1),
        ("settings, named shapes", _settings(ours, NAMED), "", 4.4),
        ("settings, unseen shapes", _settings(ours, UNSEEN), "", 5.0),
        ("settings, 95th percentile", percentile((result.settings for result in ours), 0.95), "", MOST_SETTINGS),
        ("samples against bisection", fmean(result.samples for result in ours) / halved, "x", 1),
        ("not within 1 point of the truth", share_without(abs(answer.over) <= 1 for answer in answers), "%", None),
        ("over-reservation, mean", fmean(answer.over for answer in answers), "points", 0.7),
        ("  99th percentile", percentile((answer.over for answer in answers), 0.99), "points", None),
    ]
    return [Figure(name=name, value=value, unit=unit, at_most=most) for name, value, unit, most in rows]


def _settings(found: Iterable[Result], shapes: Iterable[str]) -> float:
    wanted = set(shapes)
    return fmean(result.settings for result in found if result.shape in wanted)


def by_shape(found: Sequence[Result]) -> str:
    """Return a line for each shape: settings by strategy (mean, 95th percentile, most), and the right answers."""
    lines = [" " * 20 + "".join(f"{strategy:>20}" for strategy in STRATEGIES) + "   not right"]
    for name, shapes in [*((shape, [shape]) for shape in SHAPES), ("all", SHAPES)]:
        cells = []
        for strategy in STRATEGIES:
            counts = [result.settings for result in found if result.shape in shapes and result.strategy == strategy]
            cells.append(f"{fmean(counts):10.2f} {percentile(counts, 0.95):4.0f} {max(counts):4d}")
        right = [result.right for result in found if result.shape in shapes and result.strategy == DEFAULT]
        lines.append(f"{name:<20}" + "".join(cells) + f" {share_without(right):9.1f} %")
    return "\n".join(lines)


def main() -> int:
    count = int(sys.argv[1]) if len(sys.argv) > 1 else COMPONENTS
    tasks = [
        (shape, seed, noise) for noise in NOISES for shape in SHAPES for seed in range(math.ceil(count / len(SHAPES)))
    ]
    with Pool() as pool:
        found = [result for results_of in pool.imap_unordered(results, tasks, chunksize=4) for result in results_of]
    print(f"{len(tasks)} components, {len(NOISES)} noise levels, at most {MOST_SAMPLES} samples a setting\n")
    print("settings: mean, 95th percentile, most\n" + by_shape(found) + "\n")
    return report(figures(found))


if __name__ == "__main__":
    sys.exit(main())
