"""What `rarms measure` runs, the search and what makes it agree with a plan, beside halving and the paper's walk.

`python -m benchmarks.search [COMPONENTS]` takes so many components a noise level (1,000 unless said), spread evenly
over the shapes of `shapes.py`. An answer is *right* when it truly meets the APT within 1 % (a success rate: 1 point)
and reserves at most 1 point above the least CR that meets an APT stricter by as much.
"""

import math
import sys
from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from multiprocessing import Pool

from benchmarks.shapes import NAMED, NOISES, UNSEEN, Truth, component
from benchmarks.timing import Figure, report
from benchmarks.trials import ALLOWED, Bench, Walk, goal_of, walk
from rarms_iac.measuring.loop import Strategy
from rarms_iac.measuring.search import STRATEGIES
from rarms_iac.measuring.search.stepwise import bisect_to_width
from rarms_iac.measuring.search.trials import Goal, NextStep, Trial, sufficient, trial_of
from rarms_iac.measuring.strategies import Agreeing, Searching, Verifying
from rarms_iac.model.outcomes import Measure, NotAchievable, SearchStep, Sufficient
from rarms_iac.statistics.curves import curves_of, holds

COMPONENTS = 1000
WALKED_BY_ONE = 10  # one component in so many is walked by 1 % too: that takes fifty settings
TOLERANCE = 0.01
OURS = "measure"
HALVED = "measure --strategy bisection"
BESIDE = (HALVED, "search alone", "bisection alone", "bisection to width 3", "walk by 10", "walk by 1")
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


def by_one(history: Sequence[Trial], goal: Goal) -> SearchStep:
    """The paper's walk with a step of 1 %."""
    if not history:
        return Measure(reserve=1, until_clear=True)
    last = history[-1]
    if last.passed:
        return sufficient(history, goal, last.reserve)
    if last.reserve == 100:
        return NotAchievable(reserve=100, error=goal.error)
    return Measure(reserve=last.reserve + 1, until_clear=True)


def to_width(history: Sequence[Trial], goal: Goal) -> SearchStep:
    """Halving until the certificate of the default strategy holds: a fail at most 3 points below."""
    return bisect_to_width(history, goal, width=3)


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
        "bisection to width 3": alone(goal, to_width),
        "walk by 10": alone(goal, STRATEGIES["paper"]),
        **({"walk by 1": alone(goal, by_one)} if seed % WALKED_BY_ONE == 0 else {}),
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
    untold = {each for curve, _ in curves for each in curve.inconclusive}
    if strict:
        passed = {each for each in reserves if all(holds(curve, apt, each) for curve, apt in curves)}
    else:
        passed = {setting.reserve for setting in done.settings if trial_of(setting, goal).passed}
    return passed, reserves - passed - untold


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


def mean(numbers: Iterable[float]) -> float:
    listed = list(numbers)
    return sum(listed) / len(listed)


def figures(found: Sequence[Result]) -> list[Figure]:
    """Those that have goals, and what stands beside them."""
    ours = [one for one in found if one.strategy == OURS]
    answers = [one for one in ours if one.found]
    clear = [answer for answer in answers if answer.identifiable]
    worst = max(_not(one.right for one in ours if one.shape == shape) for shape in (*NAMED, *UNSEEN))
    halved = mean(one.samples for one in found if one.strategy == HALVED)
    return [
        Figure(name="not resolved", value=_not(one.found for one in ours), unit="%", at_most=2),
        Figure(
            name="answers without their certificate",
            value=_not(answer.certified for answer in answers),
            unit="%",
            at_most=0,
        ),
        Figure(name="not right", value=_not(one.right for one in ours), unit="%", at_most=1),
        Figure(name="not right, worst shape", value=worst, unit="%", at_most=3),
        Figure(name="settings, named shapes", value=_settings(ours, NAMED), unit="", at_most=3.5),
        Figure(name="settings, unseen shapes", value=_settings(ours, UNSEEN), unit="", at_most=4.0),
        Figure(
            name="settings, 95th percentile", value=percentile((one.settings for one in ours), 0.95), unit="", at_most=6
        ),
        Figure(name="samples against bisection", value=mean(one.samples for one in ours) / halved, at_most=1),
        Figure(
            name="not within 1 point of the truth, all",
            value=_not(abs(answer.over) <= 1 for answer in answers),
            unit="%",
        ),
        Figure(name="  of identifiable ones", value=_not(abs(one.over) <= 1 for one in clear), unit="%", at_most=1),
        Figure(name="identifiable", value=100 * len(clear) / len(answers), unit="%"),
        Figure(
            name="over-reservation, mean", value=mean(answer.over for answer in answers), unit="points", at_most=0.7
        ),
        Figure(
            name="  99th percentile",
            value=percentile((answer.over for answer in answers), 0.99),
            unit="points",
            at_most=3,
        ),
        *_beside(found),
    ]


def _beside(found: Sequence[Result]) -> Iterable[Figure]:
    for name in BESIDE:
        theirs = [one for one in found if one.strategy == name]
        yield Figure(name=f"{name}: settings", value=mean(their.settings for their in theirs), unit="")
        yield Figure(name="  samples", value=mean(their.samples for their in theirs), unit="")
        yield Figure(name="  not right", value=_not(their.right for their in theirs), unit="%")


def _not(marks: Iterable[bool]) -> float:
    return 100 * (1.0 - mean(marks))


def _settings(found: Sequence[Result], shapes: Iterable[str]) -> float:
    return mean(one.settings for one in found if one.shape in set(shapes))


def by_shape(found: Sequence[Result]) -> str:
    """A line a shape: settings, their 95th percentile, samples, right, over-reservation."""
    lines = [f"{'shape':<20} {'settings':>8} {'95 %':>5} {'samples':>8} {'right':>7} {'over':>6}"]
    for shape in (*NAMED, *UNSEEN):
        ours = [one for one in found if one.shape == shape and one.strategy == OURS]
        most = percentile((one.settings for one in ours), 0.95)
        lines.append(
            f"{shape:<20} {mean(one.settings for one in ours):8.2f} {most:5.0f}"
            f" {mean(one.samples for one in ours):8.0f} {100 * mean(one.right for one in ours):6.1f}%"
            f" {mean(one.over for one in ours if one.found):6.2f}"
        )
    return "\n".join(lines)


def main() -> int:
    count = int(sys.argv[1]) if len(sys.argv) > 1 else COMPONENTS
    shapes = (*NAMED, *UNSEEN)
    tasks = [
        (shape, seed, noise) for noise in NOISES for shape in shapes for seed in range(math.ceil(count / len(shapes)))
    ]
    with Pool() as pool:
        found = [one for many in pool.imap_unordered(results, tasks, chunksize=4) for one in many]
    print(f"{len(tasks)} components, {len(NOISES)} noise levels, at most {ALLOWED} samples a setting\n")
    print(by_shape(found) + "\n")
    return report(figures(found))


if __name__ == "__main__":
    sys.exit(main())
