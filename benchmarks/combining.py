"""Combining: how many settings the default strategy asks for, beside measuring all pairs, and how often it is right.

`python -m benchmarks.combining [INSTANCES] [MODEL ...]` takes so many instances a model (36 unless said; the goals are
stated for 400 and more), spread evenly over n = 4 to 12 components. Seeds are fixed. Pairs only, beside two simple
ways: all pairs by the paper's walk (10, 20, ... %), and all pairs by halving 1 to 100 %. What each component needs
alone is known to all of them. Models: `combining_models` and `combining_host`. Each instance is gone about in all of
`WAYS`, then half as many, of 4 to 8 components, with compounds of three, then each with the reservation first. What is
done is told as it goes.

Where a model makes a pair need less than the proof assumes, its instances are counted apart, with those of them in
which an answer showed it.
"""

import os
import sys
from collections.abc import Iterable, Iterator, Sequence
from concurrent.futures import ProcessPoolExecutor
from dataclasses import dataclass
from itertools import groupby
from statistics import median, quantiles

from benchmarks.combining_cases import MODELS, instance
from benchmarks.combining_runs import NOISE, REPEATS, Greedy, Result, Way, greedy, run
from benchmarks.timing import Figure, report, table
from rarms_iac.model.system import Minimise

INSTANCES = 36
SIZES = range(4, 13)
SIZES_OF_THREE = range(4, 9)
PROOF = {"edf": 0.35, "fair": 0.45, "mixing": 0.35, "host": 0.35}
PREDICTED = 0.20
CONTENT = 0.95

RESERVATION = Minimise.RESERVATION
PROVED, GUIDED = Way(), Way(predicts=True)
AT_A_PROBABILITY = Way(predicts=True, probability=CONTENT)
NOISY = Way(predicts=True, noisy=True)
WAYS = {"proof": PROVED, "prediction": GUIDED, "noise": NOISY, "probability": AT_A_PROBABILITY}
WAYS_RESERVATION_FIRST = {
    "proof": Way(minimise=RESERVATION),
    "prediction": Way(minimise=RESERVATION, predicts=True),
    "probability": Way(minimise=RESERVATION, predicts=True, probability=CONTENT),
}


@dataclass(frozen=True, slots=True, kw_only=True)
class Done:
    """What was run on one instance, by way."""

    model: str
    results: dict[str, Result]
    greedy: Greedy | None = None  # only with pairs, combining as little as possible


def done(model: str, components: int, seed: int) -> Done:
    """Pairs, combining as little as possible."""
    case = instance(model, components, seed)
    return Done(model=model, results={name: run(case, way) for name, way in WAYS.items()}, greedy=greedy(case))


def reservation_first(model: str, components: int, seed: int) -> Done:
    """Pairs, reserving as little as possible."""
    case = instance(model, components, seed)
    return Done(model=model, results={name: run(case, way) for name, way in WAYS_RESERVATION_FIRST.items()})


def of_three(model: str, components: int, seed: int) -> Done:
    """Compounds of two and three, beside all sets that the highest CR of a member does not rule out."""
    case = instance(model, components, seed, 3)
    return Done(model=model, results={"proof": run(case, PROVED), "prediction": run(case, GUIDED)})


def main(words: Sequence[str]) -> int:
    instances = int(words[0]) if words else INSTANCES
    models = [one for one in MODELS if one in words[1:] or not words[1:]]
    figures: list[Figure] = []
    with ProcessPoolExecutor(max_workers=min(2, os.cpu_count() or 1)) as workers:
        for what, part, sizes, tell in PARTS:
            seeds = range(-(-instances // part // len(sizes)))
            chosen = [one for one in models if what is not of_three or one != "host"]
            cases = [(model, size, seed) for model in chosen for seed in seeds for size in sizes]
            results = _told(workers.map(what, *zip(*cases, strict=True), chunksize=3), what.__name__, len(cases))
            for model, group in groupby(results, key=lambda result: result.model):
                found = list(tell(model, list(group)))
                figures += found
                print(table(found), flush=True)
    spent = os.times()
    print(f"processor time: {spent.user + spent.system + spent.children_user + spent.children_system:.0f} s")
    return report(figures)


def _told(results: Iterable[Done], what: str, number: int) -> Iterator[Done]:
    """The same, and on standard error how many are done."""
    for at, one in enumerate(results, start=1):
        if at % 45 == 0 or at == number:
            print(f"{what}: {at} of {number} instances", file=sys.stderr, flush=True)
        yield one


def _combining_first(model: str, all_of_it: Sequence[Done]) -> Iterable[Figure]:
    print(f"\n{model}: {len(all_of_it)} instances, of which {_some(all_of_it, 'proof', 'fits')} can be made to fit")
    for name in WAYS:
        results = [one.results[name] for one in all_of_it]
        _print_settings(name, results)
        if name == "prediction":
            _print_misses(results)
    _print_greedy([one.greedy for one in all_of_it if one.greedy is not None])
    yield from _settings_and_right(model, all_of_it, PREDICTED)
    yield from _stopped(model, [one.results["probability"] for one in all_of_it])
    yield from _with_noise(model, [one.results["noise"] for one in all_of_it])


def _reservation_first(model: str, all_of_it: Sequence[Done]) -> Iterable[Figure]:
    print(f"\n{model}, reservation first: {len(all_of_it)} instances")
    for name in WAYS_RESERVATION_FIRST:
        _print_settings(name, [one.results[name] for one in all_of_it])
    model_so = f"{model}, reservation first"
    yield from _settings_and_right(model_so, all_of_it, PROOF[model], PROOF[model])
    yield from _stopped(model_so, [one.results["probability"] for one in all_of_it])


def _settings_and_right(
    name: str, all_of_it: Sequence[Done], predicted: float, proof: float | None = None
) -> Iterable[Figure]:
    goals = {"proof": PROOF[name] if proof is None else proof, "prediction": predicted}
    for way, most in goals.items():
        results = [one.results[way] for one in all_of_it]
        yield Figure(name=f"{name}, {way}: median of the walk", value=_median(results), at_most=most)
        yield from _right(f"{name}, {way}", results, with_limit=way == "prediction")


def _some(all_of_it: Sequence[Done], name: str, what: str) -> int:
    return sum(bool(getattr(one.results[name], what)) for one in all_of_it)


def _median(results: Sequence[Result]) -> float:
    return median(result.of_the_walk for result in results)


def _print_settings(name: str, results: Sequence[Result]) -> None:
    few = [result for result in results if result.components == min(SIZES)]
    ratios = [result.of_the_walk for result in results]
    print(
        f"  {name}: {len(results)} instances, {sum(result.asked for result in results)} settings (walk "
        f"{sum(result.walked for result in results)}, halving "
        f"{sum(result.halved for result in results)}); of the walk: median "
        f"{median(ratios):.2f}, worst {max(ratios):.2f}; of halving: median "
        f"{median(result.of_halving for result in results):.2f}; n = 4: median {_median(few):.2f} of the walk"
    )


def _print_misses(results: Sequence[Result]) -> None:
    misses = [miss for result in results for miss in result.misses]
    errors = [abs(miss.predicted - miss.need) for miss in misses]
    inside = sum(miss.low <= miss.need <= miss.high for miss in misses)
    bias = sum(miss.predicted - miss.need for miss in misses) / len(misses)
    print(
        f"    of {len(misses)} compounds that it was not fitted to, what was predicted is off by {median(errors):.1f} "
        f"% CR in the median, {quantiles(errors, n=10)[-1]:.1f} % in one of ten or more ({bias:+.1f} % on average); "
        f"{100 * inside / len(misses):.0f} % lie in the 80 % that it expected"
    )


def _print_greedy(results: Sequence[Greedy]) -> None:
    counted = {kind: sum(result.ends == kind for result in results) for kind in ("optimal", "fits", "fails")}
    print(
        f"  the paper's greedy: {counted['optimal']} optimal, {counted['fits']} fit otherwise or with another "
        f"reservation, {counted['fails']} do not fit, in {sum(result.asked for result in results)} settings"
    )


def _right(name: str, results: Sequence[Result], *, with_limit: bool = False) -> Iterable[Figure]:
    """Where the assumption holds the end is the best there is; where it does not, that is said or counted."""
    sound = [result for result in results if not result.breaks]
    missed = sum(not one.optimal for one in sound)
    yield Figure(name=f"{name}: not the best, of {len(sound)}", value=missed, unit="", at_most=0)
    wrong = [result for result in results if result.breaks]
    if wrong:
        silent = sum(not one.optimal and not one.told for one in wrong)
        print(
            f"  {name}: the assumption is wrong in {len(wrong)} more; an answer showed it in "
            f"{sum(one.told for one in wrong)}, where nothing was claimed; {silent} were called proved and are not "
            "the best"
        )
    if with_limit:
        part = sum(not result.optimal for result in results) / len(results)
        yield Figure(name=f"{name}: not the best, of all", value=100 * part, unit="%", at_most=5)
        yield Figure(name=f"{name}: the same, upper limit", value=100 * _upper(part, len(results)), unit="%", at_most=7)


def _upper(part: float, number: int) -> float:
    """The upper limit of a proportion with 97.5 % (E. Wilson, 1927)."""
    z = 1.96
    middle = part + z * z / 2 / number
    wide = z * (part * (1 - part) / number + z * z / 4 / number**2) ** 0.5
    return float((middle + wide) / (1 + z * z / number))


def _stopped(name: str, results: Sequence[Result]) -> Iterable[Figure]:
    at = f"at {100 * CONTENT:.0f} %"
    short = [result for result in results if result.stopped]
    wrong = sum(not one.optimal for one in short)
    print(f"  {at}: {len(short)} of {len(results)} ended short of the proof, {wrong} of them not with the best")
    if short:
        yield Figure(name=f"{name}, {at}: not the best", value=100 * wrong / len(short), unit="%", at_most=5)


def _with_noise(model: str, results: Sequence[Result]) -> Iterable[Figure]:
    held, wrong = sum(result.held for result in results), sum(result.wrong for result in results)
    far, far_from_truth = (sum(not near for near in nears) for nears in _nears(results))
    told = sum(result.told for result in results)
    print(
        f"  noise of {NOISE} % CR, {REPEATS} of {REPEATS} repeats: {held} reservations are said to hold, {wrong} do "
        f"not; against what no noise would give {far_from_truth} of {len(results)} are another layout or further off; "
        f"{told} times answers contradicted each other, and nothing was claimed"
    )
    name = f"{model}, noise"
    yield Figure(name=f"{name}: another layout", value=100 * far / len(results), unit="%", at_most=10)
    yield Figure(name=f"{name}: do not hold", value=100 * wrong / max(1, held), unit="%", at_most=1)


def _nears(results: Sequence[Result]) -> tuple[list[bool], list[bool]]:
    return [result.near for result in results], [result.near_the_truth for result in results]


def _of_three(model: str, all_of_it: Sequence[Done]) -> Iterable[Figure]:
    print(f"\n{model}, compounds of two and three, {min(SIZES_OF_THREE)} to {max(SIZES_OF_THREE)} components:")
    for name in ("proof", "prediction"):
        results = [one.results[name] for one in all_of_it]
        _print_settings(name, results)
        yield Figure(name=f"{model} up to three, {name}: median of the walk", value=_median(results))
        yield from _right(f"{model} up to three, {name}", results)


PARTS = (  # what is run, for one of so many instances, of how many components, and how it is told
    (done, 1, SIZES, _combining_first),
    (of_three, 2, SIZES_OF_THREE, _of_three),
    (reservation_first, 1, SIZES, _reservation_first),
)


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
