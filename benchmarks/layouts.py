"""Whether layouts hold that were measured beside a family of loads: random layouts on the simulated host.

`python -m benchmarks.layouts [LAYOUTS [FOLDER [FAMILY ...]]]` draws until so many layouts (200 unless said)
fit beside each family: the even seeds are the half by which a family is chosen, the odd ones are unseen. Each is
measured beside every load of a family, planned, applied, and proven without a load and beside each load of the
family. FAMILY is `default`, `all`, `busy`, or names joined by `+`; unless said, `busy` and `default`. FOLDER keeps the
data logs and `layouts.jsonl`: what it has is not done again, so that a run that was killed goes on. HALF in the
environment is `development` or `unseen` where one of them is enough.

Layouts with a percentile, a success time or a deadline below work / reserve + window of a job that is shorter than the
window are counted apart: what their neighbours do decides these. It fails where the lower 95 % limit of the other
unseen layouts that miss exceeds 1 %, and where more than a third as many with such tails miss as beside the busy loop.
"""

import json
import math
import os
import random
import shutil
import sys
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import asdict, dataclass
from functools import partial
from multiprocessing import Pool
from pathlib import Path

import rarms_iac as rarms
from benchmarks.timing import Figure, report
from rarms_iac.app.hosts import Hosts
from rarms_iac.app.use_case_errors import UseCaseError
from rarms_iac.measuring.measure_request import MeasureRequest
from rarms_iac.measuring.prove import ProveRequest
from rarms_iac.model.loads import BUSY_LOOP, DEFAULT_LOADS, LOADS_WITHOUT_ENTRY
from rarms_iac.model.outcomes import Missed
from rarms_iac.statistics.distributions import share_interval

LAYOUTS = 200
PROCESSES = int(os.environ.get("PROCESSES", "2"))
WINDOW_MS = 100.0
MOST_MISSED = 1.0  # per cent of the unseen layouts
MOST_TAILS_MISSED = 1 / 3  # of those that miss where the same layouts are measured beside the busy loop alone
DRAW = 5  # drawn anew, as the next, where the unseen half was looked at before a family was changed
MOST_DRAWN = 5  # times the layouts that are asked for: so many draws at most
HALVES = {"development": 0, "unseen": 1}  # by the remainder of the seed
LONGEST = "5 min"  # so long a proof runs, and a setting that is not clear before, on the host's clock

Family = tuple[str, ...]


@dataclass(frozen=True, slots=True, kw_only=True)
class Drawn:
    """A component of a random layout."""

    name: str
    processors: int
    threads: int
    work_ms: float  # of all threads together
    blocked_ms: float
    varies: int
    every_ms: float  # 0: closed
    threshold: str  # of `apt`
    limit_ms: float  # by which an answer must be there in the tail; 0: a mean
    success_within_ms: float
    weight: int  # 0: left open

    @property
    def alone_ms(self) -> float:
        """How long a job works with processors to itself."""
        return self.work_ms / self.threads

    def has_short_tail(self, reserve: float) -> bool:
        """Whether what neighbours do within a window decides its threshold; `reserve`: a fraction of each processor."""
        return 0.0 < self.limit_ms < self.alone_ms / reserve + WINDOW_MS and self.alone_ms < WINDOW_MS


@dataclass(frozen=True, slots=True, kw_only=True)
class DrawnLayout:
    """A host with components that fit it beside a load that never pauses, by what they demand."""

    seed: int
    logical_processors: int
    kept_percent: int
    components: tuple[Drawn, ...]

    def manifest(self, family: Family, until: str = "") -> str:
        """Return the manifest: measured beside a family; `until`: how long each component runs, as `run` says it."""
        lines = [
            "schema: rarms/v1",
            f"application: {{ name: layout-{self.seed} }}",
            "hosts:",
            f"  onboard: {{ logical_processors: {self.logical_processors}, memory: 16 GiB, "
            f"keep_for_host: {{ processor: {self.kept_percent} % }} }}",
            f"policy: {{ interference: [{', '.join(family)}], measuring: {{ setting: {LONGEST}, proof: {LONGEST} }} }}",
            "components:",
        ]
        for number, each in enumerate(self.components, start=1):
            within = f", success_within: {each.success_within_ms:.3f} ms" if each.success_within_ms else ""
            arrival = f", arrival: {{ every: {each.every_ms:.3f} ms }}" if each.every_ms else ""
            weight = f", weight: {each.weight}" if each.weight else ""
            lines += [
                f"  {each.name}:",
                f"    criticality: {number}",
                f"    apt: {{ {each.threshold} }}",
                f"    run: {{ command: [{each.name}], timeout: 10 min{until}{arrival} }}",
                f"    processors: {each.processors}",
                "    memory: 256 MiB",
                f"    cpu: {{ reserve: measured{weight} }}",
                f"    simulation: {{ work: {each.work_ms:.3f} ms, blocked: {each.blocked_ms:.3f} ms, "
                f"varies: {each.varies} %, threads: {each.threads}{within} }}",
            ]
        return "\n".join(lines) + "\n"


def draw(seed: int) -> DrawnLayout:
    """Draw a layout.

    Half of the layouts have a neighbour whose period is 5 to 20 ms, so that a third of those that fit has one. Half are
    a pair of periodic components on one LP, what neighbours hurt most; half of these have low limits.
    Each component is drawn with a reserve between what its jobs demand and what the host has left, and its threshold is
    what that reserve gives a job beside neighbours that take theirs in one piece: so most layouts fit.
    """
    chance = random.Random(f"layout/{DRAW}/{seed}")
    is_pair = seed // 4 % 2 == 0
    has_short = seed // 2 % 2 == 0
    processors = 1 if is_pair else chance.choice((1, 1, 2, 2, 4))
    kept = chance.choice((0, 0, 10, 20))
    count = 2 if is_pair else chance.randint(2, 3 if processors == 1 else 6)
    has_tails = not is_pair and chance.random() < 0.6
    available = processors * (1.0 - kept / 100.0) * chance.uniform(0.6, 0.9)
    parts = [chance.uniform(0.3, 1.0) for _ in range(count)]
    components = tuple(
        _draw_component(
            chance,
            f"c{number}",
            available * part / sum(parts),
            processors,
            is_short=number == 0 and has_short,
            is_periodic=is_pair,
            is_tight=is_pair and seed // 8 % 2 == 0,
            has_tails=has_tails,
        )
        for number, part in enumerate(parts)
    )
    return DrawnLayout(seed=seed, logical_processors=processors, kept_percent=kept, components=components)


def has_short_period(seed: int) -> bool:
    """Whether a layout has a neighbour whose period is 5 to 20 ms."""
    return any(0.0 < each.every_ms <= 20.0 for each in draw(seed).components)


def _draw_component(
    chance: random.Random,
    name: str,
    share: float,
    most: int,
    *,
    is_short: bool,
    is_periodic: bool,
    is_tight: bool,
    has_tails: bool,
) -> Drawn:
    """Draw a component that fits `share` logical processors of a host that has `most`."""
    processors = most if most > 1 and chance.random() < 0.3 else 1
    threads = chance.choice((1, processors))
    reserve = min(0.9, share / processors)
    alone = math.exp(chance.uniform(math.log(2.0), math.log(150.0)))
    every, blocked = 0.0, 0.0
    if is_short or is_periodic or chance.random() < 0.6:
        demand = reserve * chance.uniform(0.15, 0.8)
        every = chance.uniform(5.0, 20.0) if is_short else alone / demand
        alone = every * demand
    else:
        blocked = alone * chance.choice((0.0, chance.uniform(0.0, 1.0)))
    slowest = alone / reserve
    mean = slowest * chance.uniform(1.05, 1.4) + blocked
    if every:  # it saves claim between its jobs, and its limit may be nearer to its work
        slack = chance.uniform(0.05, 0.4) if is_tight else chance.uniform(0.3, 1.3)
        mean = alone * (1.0 + (1.0 / reserve - 1.0) * slack)
    tail = min(250.0, max(5.0, mean + WINDOW_MS * chance.uniform(0.1, 1.5)))
    kinds = ("mean", "percentile", "success", "deadline" if every else "mean") if has_tails else ("mean",)
    threshold, limit, within = f"mean_response_time: {{ at_most: {mean:.3f} ms }}", 0.0, 0.0
    match chance.choice(kinds):
        case "percentile":
            threshold, limit = f"p{chance.choice((90, 95))}_response_time: {{ at_most: {tail:.3f} ms }}", tail
        case "success":
            threshold, limit, within = "success_rate: { at_least: 95 % }", tail, tail
        case "deadline":
            threshold, limit = "deadline_miss_rate: { at_most: 5 % }", every
        case _:
            pass
    return Drawn(
        name=name,
        processors=processors,
        threads=threads,
        work_ms=alone * threads,
        blocked_ms=blocked,
        varies=chance.choice((0, 2, 10, 30)),
        every_ms=every,
        threshold=threshold,
        limit_ms=limit,
        success_within_ms=within,
        weight=chance.choice((0, 0, 0, 50, 100)),
    )


@dataclass(frozen=True, slots=True, kw_only=True)
class Outcome:
    """What became of a layout that was measured beside a family."""

    seed: int
    family: str
    ending: str  # held, missed, or no plan: it does not fit, or a component has no answer
    tails: bool  # a threshold depends on what neighbours do
    reserved_lp: float = 0.0
    missed: tuple[str, ...] = ()  # component, index and load; of no plan the findings


def outcome_of(family: Family, folder: Path, seed: int) -> Outcome:
    """Measure, plan, apply and prove a layout."""
    layout, place = draw(seed), folder / str(seed)
    place.mkdir(parents=True, exist_ok=True)
    words = "+".join(family)
    (place / "rarms.yaml").write_text(layout.manifest(family), encoding="utf-8")
    shutil.rmtree(place / ".rarms", ignore_errors=True)
    hosts = rarms.load(str(place / "rarms.yaml"))
    for load in family[1:] or family:  # each begins at what the first one asks for: the logs serve every family
        rarms.measure(hosts, MeasureRequest(interference=tuple(dict.fromkeys((family[0], load)))))
    try:
        plan = rarms.plan(hosts)
    except UseCaseError as problem:
        codes = sorted({diagnostic.code for diagnostic in problem.findings})
        return Outcome(seed=seed, family=words, ending="no plan", tails=False, missed=tuple(codes))
    rarms.apply(plan)
    state = hosts.open("onboard").observe()
    partitions = {each.settings.name: each.settings for each in state.partitions}
    tails = any(each.has_short_tail(partitions[each.name].reserve / 100) for each in layout.components)
    missed = tuple(sorted(_missed(hosts, family)))
    return Outcome(
        seed=seed,
        family=words,
        ending="missed" if missed else "held",
        tails=tails,
        reserved_lp=sum(each.reserve * each.processors for each in partitions.values()) / 100,
        missed=missed,
    )


def _missed(hosts: Hosts, family: Family) -> Iterator[str]:
    """Each threshold that was shown to miss, without a load and beside each."""
    for request in (ProveRequest(without_load=True), ProveRequest(interference=tuple(family))):
        for proof in rarms.prove(hosts, request).proofs:
            for verdict in proof.verdicts:
                if isinstance(verdict.verdict, Missed):
                    load = proof.interference or "no load"
                    yield f"{verdict.measured.component} {verdict.measured.index} beside {load}"


def figures(outcomes: Sequence[Outcome], half: str) -> list[Figure]:
    """Of a half of the layouts by one family: how many were planned, and missed; those with tails apart."""
    planned = [each for each in outcomes if each.ending != "no plan"]
    rows = [
        Figure(name=f"{half}: no plan", value=len(outcomes) - len(planned), unit=""),
        Figure(
            name="  with a period of 5 to 20 ms", value=sum(has_short_period(each.seed) for each in planned), unit=""
        ),
        Figure(name="  reserved", value=sum(each.reserved_lp for each in planned) / max(1, len(planned)), unit="LP"),
    ]
    for kind, tails in (("", False), (" with tails of short jobs", True)):
        own = [each for each in planned if each.tails == tails]
        amiss = sum(each.ending == "missed" for each in own)
        least = 100 * share_interval(amiss, len(own), error=0.1)[0] if own else 0.0
        limit = MOST_MISSED if half == "unseen" and not tails else None
        rows += [
            Figure(name=f"  {len(own)} layouts{kind}, missed", value=100 * amiss / max(1, len(own)), unit="%"),
            Figure(name="    at least, by 95 %", value=least, unit="%", at_most=limit),
        ]
    return rows


def comparison(by_family: Mapping[Family, Sequence[Outcome]], half: str) -> list[Figure]:
    """On the layouts that every family could plan: what each reserves and misses, and with tails against the first."""
    planned = {
        family: {each.seed: each for each in outcomes if each.ending != "no plan"}
        for family, outcomes in by_family.items()
    }
    common = set.intersection(*(set(each) for each in planned.values()))
    rows, most_tails = [], math.inf
    for family, of_seed in planned.items():
        own = [of_seed[seed] for seed in sorted(common)]
        missed = [each for each in own if each.ending == "missed"]
        with_tails = sum(each.tails for each in missed)
        limit = most_tails if half == "unseen" and family != (BUSY_LOOP,) and math.isfinite(most_tails) else None
        rows += [
            Figure(
                name=f"{'+'.join(family)}: reserved on {len(own)} that all plan",
                value=sum(each.reserved_lp for each in own) / max(1, len(own)),
                unit="LP",
            ),
            Figure(name="  missed", value=len(missed) - with_tails, unit=""),
            Figure(name="  missed with tails of short jobs", value=with_tails, unit="", at_most=limit),
        ]
        if family == (BUSY_LOOP,):
            most_tails = with_tails * MOST_TAILS_MISSED
    return rows


def families(words: Sequence[str]) -> list[Family]:
    """Read the families that were named."""
    named = {"default": DEFAULT_LOADS, "all": tuple(LOADS_WITHOUT_ENTRY), "busy": (BUSY_LOOP,)}
    return [named.get(word) or tuple(word.split("+")) for word in words or ("busy", "default")]


def main() -> int:
    """Print a table for each family and half; 1 where unseen layouts miss more often than may be."""
    wanted = int(sys.argv[1]) if len(sys.argv) > 1 else LAYOUTS
    folder = Path(sys.argv[2]) if len(sys.argv) > 2 else Path("/dev/shm/rarms-layouts")
    folder.mkdir(parents=True, exist_ok=True)
    code = 0
    for half in [os.environ["HALF"]] if "HALF" in os.environ else HALVES:
        by_family = outcomes_of(families(sys.argv[3:]), folder, half, wanted // 2)
        for family, outcomes in by_family.items():
            print(f"== {'+'.join(family)}")
            code |= report(figures(outcomes, half))
        code |= report(comparison(by_family, half))
    return code


def outcomes_of(wanted: Sequence[Family], folder: Path, half: str, layouts: int) -> dict[Family, list[Outcome]]:
    """Draw, seed by seed, until so many layouts of a half fit beside each family.

    Args:
        wanted: the families; a layout that is left out of one, since it does not fit, stays one of the others.
        folder: keeps each outcome as it is found.
        half: `development` or `unseen`.
        layouts: that shall fit; at most five times as many are drawn.

    Returns:
        The outcomes of each family, in the order of the seeds, those without a plan among them.
    """
    file = folder / "layouts.jsonl"
    lines = file.read_text(encoding="utf-8").splitlines() if file.exists() else []
    known = [Outcome(**{**each, "missed": tuple(each["missed"])}) for each in map(json.loads, lines)]
    of_seed: dict[int, list[Outcome]] = {}
    for each in known:
        of_seed.setdefault(each.seed, []).append(each)
    found: dict[Family, list[Outcome]] = {family: [] for family in wanted}
    seeds = range(HALVES[half], 2 * MOST_DRAWN * layouts, 2)
    with Pool(PROCESSES) as pool, file.open("a", encoding="utf-8") as written:
        for new, old in pool.imap(partial(_outcomes_of_seed, tuple(wanted), folder, of_seed), seeds):
            written.writelines(f"{json.dumps(asdict(outcome))}\n" for outcome in new)
            written.flush()
            for outcome in (*old, *new):
                print(f"layout {outcome.seed} beside {outcome.family}: {outcome.ending}", flush=True)
                if (family := tuple(outcome.family.split("+"))) in found:
                    found[family].append(outcome)
            if all(sum(each.ending != "no plan" for each in outcomes) >= layouts for outcomes in found.values()):
                break
        pool.terminate()
    return found


def _outcomes_of_seed(
    wanted: Sequence[Family], folder: Path, known: Mapping[int, Sequence[Outcome]], seed: int
) -> tuple[list[Outcome], Sequence[Outcome]]:
    old = known.get(seed, ())
    done = {each.family for each in old}
    return [outcome_of(family, folder, seed) for family in wanted if "+".join(family) not in done], old


if __name__ == "__main__":
    sys.exit(main())
