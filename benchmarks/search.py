"""What `rarms measure` runs, the search and what makes it agree with a plan, beside halving and the paper's walk.

`python -m benchmarks.search [COMPONENTS]` takes so many components a noise level (1,000 unless said), spread evenly
over the shapes of `components.py`. An answer is *right* when it truly meets the APT within 1 % (a success rate: 1
point) and reserves at most 1 point above the least CR that meets an APT stricter by as much.
"""

import math
import sys
from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from multiprocessing import Pool
from statistics import fmean

from benchmarks.components import ALLOWED, NAMED, NOISES, UNSEEN, Bench, Truth, Walk, component, goal_of, walk
from benchmarks.timing import Figure, report
from rarms_iac.measuring.loop import Strategy
from rarms_iac.measuring.search import STRATEGIES
from rarms_iac.measuring.search.trials import Goal, NextStep, trial_of
from rarms_iac.measuring.strategies import Agreeing, Searching, Verifying
from rarms_iac.model.outcomes import Sufficient
from rarms_iac.statistics.curves import curves_of, holds

COMPONENTS = 1000
TOLERANCE = 0.01
OURS = "measure"
HALVED = "measure --strategy bisection"
BESIDE = (HALVED, "search alone", "bisection alone", "walk by 10")
SHAPES = (*NAMED, *UNSEEN)
MOST = 100  # the CR that the host can give
CLEAR = 2.58  # deviations of the index, with all samples allowed


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
    identifiable: bool


def measured(goal: Goal, strategy: str) -> Agreeing:
    """What `rarms measure --strategy` runs: a search, then what a plan reserves is measured itself."""
    return Agreeing(search=alone(goal, STRATEGIES[strategy]), verifying=Verifying(goal=goal, most=MOST))


def alone(goal: Goal, next_step: NextStep) -> Searching:
    """A search that ends with its own answer, whatever a plan would reserve."""
    return Searching(goal=goal, next_step=next_step, most=MOST)


def results(task: tuple[str, int, float]) -> list[Result]:
    """All strategies on one component, which they measure in the same state of chance."""
    shape, seed, noise = task
    truth = component(shape, seed, noise)
    goal = goal_of(truth)
    bench = Bench(truth, goal)
    strategies: dict[str, Strategy] = {
        OURS: measured(goal, "default"),
        HALVED: measured(goal, "bisection"),
        "search alone": alone(goal, STRATEGIES["default"]),
        "bisection alone": alone(goal, STRATEGIES["bisection"]),
        "walk by 10": alone(goal, STRATEGIES["paper"]),
    }
    return [_result(truth, goal, name, walk(strategy, bench)) for name, strategy in strategies.items()]


def _result(truth: Truth, goal: Goal, strategy: str, done: Walk) -> Result:
    answer = done.end.reserve if isinstance(done.end, Sufficient) else 0
    passed, failed = _told_apart(goal, done, strict=strategy in (OURS, HALVED))
    return Result(
        shape=truth.shape,
        strategy=strategy,
        settings=len(done.settings),
        samples=done.samples,
        found=answer > 0,
        certified=answer in passed and (answer == 1 or any(answer - 3 <= reserve < answer for reserve in failed)),
        right=answer > 0 and truth.meets(answer, stricter=-TOLERANCE) and answer <= truth.least(stricter=TOLERANCE) + 1,
        over=answer - truth.least(),
        identifiable=_identifiable(truth),
    )


def _told_apart(goal: Goal, done: Walk, *, strict: bool) -> tuple[set[int], set[int]]:
    """The settings that were measured as passing, and as failing: by the curve that a plan rests on, or by verdicts.

    One without a steady state is neither.
    """
    reserves = {setting.reserve for setting in done.settings}
    apts = {member.name: member.apt for member in goal.members}
    curves = curves_of(done.settings, {member.name: member.run for member in goal.members}, apts)
    inconclusive = {each for curve, _ in curves for each in curve.inconclusive}
    if strict:
        passed = {each for each in reserves if all(holds(curve, apt, each) for curve, apt in curves)}
    else:
        passed = {setting.reserve for setting in done.settings if trial_of(setting, goal).passed}
    return passed, reserves - passed - inconclusive


def _identifiable(truth: Truth) -> bool:
    """Whether the samples allowed tell a point beyond the neighbours of the least CR apart from the APT."""
    least = truth.least()
    worth = ALLOWED * (1.0 - truth.correlation) / (1.0 + truth.correlation)
    if truth.limit_ms is None:
        error = truth.apt * truth.noise / math.sqrt(worth)
    else:
        error = math.sqrt(truth.apt * (100 - truth.apt) / worth)
    near = [reserve for reserve in (least - 2, least + 1) if 1 <= reserve <= 100]
    return all(abs(truth.index(reserve) - truth.apt) >= CLEAR * error for reserve in near)


def percentile(numbers: Iterable[float], share: float) -> float:
    ordered = sorted(numbers)
    return ordered[math.ceil(share * len(ordered)) - 1]


def share_without(marks: Iterable[bool]) -> float:
    """Per cent of these that are not so."""
    return 100 * (1.0 - fmean(marks))


def figures(found: Sequence[Result]) -> list[Figure]:
    """Those that have goals, and what stands beside them."""
    ours = [result for result in found if result.strategy == OURS]
    answers = [result for result in ours if result.found]
    clear = [result for result in answers if result.identifiable]
    worst = max(share_without(result.right for result in ours if result.shape == shape) for shape in SHAPES)
    halved = fmean(result.samples for result in found if result.strategy == HALVED)

    def settings(shapes: Iterable[str]) -> float:
        return fmean(result.settings for result in ours if result.shape in set(shapes))

    rows: list[tuple[str, float, str, float | None]] = [
        ("not resolved", share_without(result.found for result in ours), "%", 2),
        ("answers without their certificate", share_without(answer.certified for answer in answers), "%", 0),
        ("not right", share_without(result.right for result in ours), "%", 1),
        ("not right, worst shape", worst, "%", 3),
        ("settings, named shapes", settings(NAMED), "", 3.5),
        ("settings, unseen shapes", settings(UNSEEN), "", 4.0),
        ("settings, 95th percentile", percentile((result.settings for result in ours), 0.95), "", 6),
        ("samples against bisection", fmean(result.samples for result in ours) / halved, "x", 1),
        ("not within 1 point of the truth", share_without(abs(answer.over) <= 1 for answer in answers), "%", None),
        ("  of identifiable ones", share_without(abs(answer.over) <= 1 for answer in clear), "%", 1),
        ("identifiable", 100 * len(clear) / len(answers), "%", None),
        ("over-reservation, mean", fmean(answer.over for answer in answers), "points", 0.7),
        ("  99th percentile", percentile((answer.over for answer in answers), 0.99), "points", 3),
    ]
    for name in BESIDE:
        others = [result for result in found if result.strategy == name]
        rows += [
            (f"{name}: settings", fmean(result.settings for result in others), "", None),
            ("  samples", fmean(result.samples for result in others), "", None),
            ("  not right", share_without(result.right for result in others), "%", None),
        ]
    return [Figure(name=name, value=value, unit=unit, at_most=most) for name, value, unit, most in rows]


def by_shape(found: Sequence[Result]) -> str:
    """A line a shape: settings, their 95th percentile, samples, right, over-reservation."""
    lines = [f"{'shape':<20} {'settings':>8} {'95 %':>5} {'samples':>8} {'right':>7} {'over':>6}"]
    for shape in SHAPES:
        ours = [result for result in found if result.shape == shape and result.strategy == OURS]
        most = percentile((result.settings for result in ours), 0.95)
        lines.append(
            f"{shape:<20} {fmean(result.settings for result in ours):8.2f} {most:5.0f}"
            f" {fmean(result.samples for result in ours):8.0f} {100 * fmean(result.right for result in ours):6.1f}%"
            f" {fmean(result.over for result in ours if result.found):6.2f}"
        )
    return "\n".join(lines)


def main() -> int:
    count = int(sys.argv[1]) if len(sys.argv) > 1 else COMPONENTS
    tasks = [
        (shape, seed, noise) for noise in NOISES for shape in SHAPES for seed in range(math.ceil(count / len(SHAPES)))
    ]
    with Pool() as pool:
        found = [one for many in pool.imap_unordered(results, tasks, chunksize=4) for one in many]
    print(f"{len(tasks)} components, {len(NOISES)} noise levels, at most {ALLOWED} samples a setting\n")
    print(by_shape(found) + "\n")
    return report(figures(found))


if __name__ == "__main__":
    sys.exit(main())
