"""How near the answers of `rarms measure` are: random components on the simulated host, against long runs.

`python -m benchmarks.measuring [FIRST LAST [ANSWERS]]` measures components FIRST to LAST of the draw (0 to 399 unless
said) by the default strategy, by it with `slow_job: 1`, and by bisection, with the loads of the default policy.
Components work 0.5 to 500 ms a job, closed or periodic, on 1 to 4 threads and a host of 1 to 8 LPs, of which time may
be kept. A threshold is what long runs show within one point of a random reservation, or is out of reach. Where two
points less are hardly worse, as on the floor of a curve, a threshold lies near no reservation: another one below is
drawn. The truth is the least reservation at which a long run with each load meets the threshold. ANSWERS is a file of
JSON Lines: components that it has, with the same jobs, budget and loads, are not measured again.

In the environment: JOBS of a long run (20,000), BUDGET of a setting (2 h), LOADS (joined by `+`), PROCESSES.
"""

import json
import math
import os
import random
import sys
import tempfile
import time
from collections.abc import Iterator, Sequence
from dataclasses import asdict, dataclass, field, replace
from multiprocessing import Pool
from pathlib import Path
from statistics import fmean, pstdev
from typing import Literal

import rarms_iac as rarms
from benchmarks.timing import Figure, report
from rarms_iac.app.hosts import Hosts
from rarms_iac.measuring.each_load import decisive
from rarms_iac.measuring.measure_request import ExperimentResult, MeasureRequest
from rarms_iac.measuring.partitions import (
    MeasuringResources,
    highest_reserve,
    host_resources,
    load_share,
    processors_of_load,
)
from rarms_iac.model.experiment import Experiment, experiments_of
from rarms_iac.model.indexes import index_named, percentile_of
from rarms_iac.model.loads import DEFAULT_LOADS
from rarms_iac.model.outcomes import NotAchievable, WithinNoise
from rarms_iac.model.series import MOST_SAMPLES, Sample, Series, columns_of
from rarms_iac.model.setting import P1, P2_WEIGHT
from rarms_iac.model.system import Threshold, run_of
from rarms_iac.providers.simulated.measuring import demand_of, model_load
from rarms_iac.providers.simulated.scheduling.machine import QUIET_INTERRUPTS, ModelMachine, VirtualMachine
from rarms_iac.providers.simulated.scheduling.simulation import SchedulerSimulation
from rarms_iac.statistics.distributions import ERROR, samples_needed, share_interval
from rarms_iac.statistics.samples import response_times
from rarms_iac.statistics.verdicts import judge_look, samples_to_clear
from rarms_iac.storage.datalog.files import read_log

COMPONENTS = 400
PROCESSES = int(os.environ.get("PROCESSES", "2"))
JOBS = int(os.environ.get("JOBS", "20000"))
BUDGET = os.environ.get("BUDGET", "2 h")
LOADS = tuple(os.environ.get("LOADS", "+".join(DEFAULT_LOADS)).split("+"))

STRATEGIES: dict[str, tuple[Literal["default", "bisection"], int]] = {
    "default": ("default", 20),
    "slow_job 1": ("default", 1),
    "bisection": ("bisection", 20),
}
"""By what a row is called: `--strategy`, and `policy.measuring.slow_job`."""
NEAR_WHOLE = 3
"""So near the highest reservation, no answer is no failure: the noise of a threshold reaches beyond the host."""

NEAR_POINTS, NEAR_PART = 2, 0.1
"""So near the final answer, by points or as a part of it, one of the first pass is near."""

LESS, WORSE = 2, 1.01
"""So many points below the reservation that a threshold is drawn at, its index is at least so many times worse."""

TRUE_SEED, TRUE_STARTS = 2, 100
WHOLE_HOST_PART = 10  # of the jobs, where it is only asked what partitions as wide as the host took
SETTLED_MS, LEAST_MS = 1000.0, 500.0
"""After which what was measured of a start counts, and how long at least."""

IN_MEMORY = "/dev/shm"  # where there is one: what a host promises to have on the disk is not what is measured here
INDEXES = (
    "mean_response_time",
    "mean_response_time",
    "p90_response_time",
    "p95_response_time",
    "p99_response_time",
    "jitter",
    "maximum_response_time",
    "minimum_response_time",
    "success_rate",
    "deadline_miss_rate",
    "throughput",
)


@dataclass(frozen=True, slots=True, kw_only=True)
class Drawn:
    """A random component on a host of its own, and where its threshold lies."""

    name: str
    logical_processors: int
    kept_percent: int
    threads: int
    work_ms: float  # of all threads together
    blocked_ms: float
    varies: float
    every_ms: float  # 0: closed
    index: str
    reserve: int  # that its threshold is drawn at, in per cent of its VPs; 101: out of reach
    within: float  # points below it, 0..1

    @property
    def used(self) -> int:
        """The processors that it uses at once."""
        return min(self.threads, self.logical_processors)

    def manifest(self, processors: int = 0, limit: float = 1.0, slow_job: int = 20) -> str:
        """Return the manifest.

        Args:
            processors: of its partition; 0: left open.
            limit: of its index, in ms or a second; of a share of jobs, the time within which they must answer.
            slow_job: of its policy.
        """
        threshold, within, deadline = f"{{ at_most: {limit:.6f} ms }}", "", ""
        match self.index:
            case "success_rate":
                threshold, within = "{ at_least: 95 % }", f", success_within: {limit:.6f} ms"
            case "deadline_miss_rate":
                threshold, deadline = "{ at_most: 5 % }", f", deadline: {limit:.6f} ms"
            case "throughput":
                threshold = f"{{ at_least: {1 / limit:.6f} /s }}"
            case _:
                pass
        every = f", arrival: {{ every: {self.every_ms:.4f} ms }}" if self.every_ms else ""
        number = f"    processors: {processors}\n" if processors else ""
        return f"""\
schema: rarms/v1
application: {{ name: near }}
hosts:
  onboard:
    logical_processors: {self.logical_processors}
    memory: 4 GiB
    keep_for_host: {{ processor: {self.kept_percent} % }}
policy: {{ interference: [{", ".join(LOADS)}], measuring: {{ setting: {BUDGET}, slow_job: {slow_job} }} }}
components:
  {self.name}:
    criticality: 1
    memory: 512 MiB
{number}    apt: {{ {self.index}: {threshold} }}
    run: {{ command: [job], timeout: 60 min{every}{deadline} }}
    simulation:
      {{ work: {self.work_ms:.4f} ms, blocked: {self.blocked_ms:.4f} ms, varies: {self.varies:g} %,
        threads: {self.threads}{within} }}
"""


def draw(seed: int) -> Drawn:
    """Draw a component."""
    chance = random.Random(f"component/2/{seed}")
    work = math.exp(chance.uniform(math.log(0.5), math.log(500.0)))
    processors, threads, kept = chance.randint(1, 8), chance.randint(1, 4), chance.choice((0, 0, 10, 20))
    index = chance.choice(INDEXES)
    reserve = 101 if chance.random() < 0.1 else chance.randint(3, 97)
    alone = work / min(threads, processors)
    blocked = alone * chance.choice((0.0, 0.0, chance.uniform(0.0, 1.0)))
    is_periodic = index != "throughput" and chance.random() < 0.5
    return Drawn(
        name=f"c{seed}",
        logical_processors=processors,
        kept_percent=kept,
        threads=threads,
        work_ms=work,
        blocked_ms=blocked,
        varies=chance.choice((0.0, 2.0, 10.0, 30.0)),
        every_ms=(100 * alone / min(reserve, 100) + blocked) * chance.uniform(1.1, 3.0) if is_periodic else 0.0,
        index=index,
        reserve=reserve,
        within=chance.random(),
    )


@dataclass(slots=True)
class LongRuns:
    """What long runs of a component show at each reservation of so many VPs, with every load."""

    drawn: Drawn
    hosts: Hosts
    loads: tuple[str, ...]
    jobs: int  # of each, in all
    experiments: tuple[Experiment, ...] = field(init=False)  # one a load
    resources: MeasuringResources = field(init=False)
    highest: int = field(init=False)  # the highest CR that its host can give
    _series: dict[int, tuple[Series, ...]] = field(default_factory=dict)

    def __post_init__(self) -> None:
        system, host = self.hosts.system, self.hosts.system.hosts["onboard"]
        self.experiments = experiments_of(system, host, (self.drawn.name,), self.loads)
        self.resources = host_resources(host, self.hosts.open(host.name).observe(), system.application.name)
        self.highest = highest_reserve(self.resources, self.experiments[0].setup)

    @property
    def processors(self) -> int:
        """Of its partition."""
        return self.experiments[0].setup.processors

    def at(self, reserve: int) -> tuple[Series, ...]:
        """Return a long run with each load, of many starts of the load, each settled."""
        if reserve not in self._series:
            machines = [self.machine(experiment, reserve) for experiment in self.experiments]
            self._series[reserve] = tuple(long_run(machine, self.drawn.name, self.jobs) for machine in machines)
        return self._series[reserve]

    def machine(self, experiment: Experiment, reserve: int) -> ModelMachine:
        """Return the machine on which this experiment runs at a CR."""
        setup, processors = experiment.setup, experiment.host.logical_processors
        of_part = processors_of_load(self.resources, setup, experiment.load, experiment.usual_load_parts)
        share = load_share(self.resources, setup, reserve, of_part)
        assert share is not None, "no more than the highest is asked for"
        p1 = VirtualMachine(
            name=P1,
            vps=setup.processors,
            reserve=reserve,
            limit=setup.limit,
            weight=setup.weight,
            components=tuple(map(demand_of, experiment.members)),
        )
        p2 = (
            VirtualMachine(
                name=name, vps=vps, reserve=part, weight=P2_WEIGHT, loads=(model_load(experiment.load, part),)
            )
            for vps, (name, part) in zip(of_part, share.reserves.items(), strict=True)
        )
        return ModelMachine(lps=processors, machines=(p1, *p2), interrupts=QUIET_INTERRUPTS)

    def level(self, reserve: int) -> float:
        """Return what should fall with the CR, with the load where it is highest (`level_of`)."""
        return max(level_of(self.drawn.index, series) for series in self.at(reserve))

    def least(self, limit: float) -> int:
        """Return the least CR at which a long run with each load meets a limit; one above the highest: none does."""
        low, high = 0, self.highest + 1
        while high - low > 1:
            middle = (low + high) // 2
            low, high = (low, middle) if self.level(middle) <= limit * (1 + 1e-6) else (middle, high)
        return high


def rate_of(series: Series) -> float:
    """Jobs a second."""
    return 1000 * len(series.samples) / series.elapsed_ms


def level_of(index: str, series: Series) -> float:
    """Return what falls with the CR: the index in ms, the time between jobs, or the 95th percentile."""
    times = sorted(response_times(series.samples))
    match index:
        case "mean_response_time":
            return fmean(times)
        case "jitter":
            return pstdev(times)
        case "maximum_response_time":
            return times[-1]
        case "minimum_response_time":
            return times[0]
        case "throughput":
            return 1 / rate_of(series)
        case _:
            percentile = percentile_of(index)
            share = 0.95 if percentile is None else float(percentile) / 100
            return times[math.ceil(share * len(times)) - 1]


def long_run(machine: ModelMachine, name: str, jobs: int) -> Series:
    """Run a component for so many jobs in all, over many starts of its load."""
    samples, starts = list[Sample](), list[int]()
    now = began = since = counted = 0.0
    running = SchedulerSimulation(machine, TRUE_SEED)
    for job in running:
        now = max(now, job.began + job.response)
        if now - began < SETTLED_MS:
            since = now
            continue
        at = job.began - since + counted
        samples.append(Sample(began_ms=at, response_ms=job.response, successful=True))
        if len(samples) * TRUE_STARTS >= jobs * (len(starts) + 1) and now - since >= LEAST_MS:
            counted += now - since
            if len(starts) + 1 == TRUE_STARTS:
                break
            starts.append(len(samples))
            running.restart_loads()
            began = since = now
    return Series(component=name, samples=tuple(samples), elapsed_ms=counted, starts=tuple(starts))


@dataclass(frozen=True, slots=True, kw_only=True)
class Answer:
    """What a strategy found of a component, next to the truth."""

    strategy: str
    component: str
    index: str
    ending: str  # `ExperimentResult.ending`
    processors: int  # VPs as used
    reserve: int  # in per cent of these; 0: none was found
    truth: int  # one above `highest`: no reservation is enough
    highest: int  # that the host can give
    is_wrong: bool
    is_conditional: bool  # met, if no job slower than some time occurs more often than was seen
    needs: int  # samples of a setting near the whole host, to show what is true there
    is_short: bool  # its budget holds fewer
    settings: int
    seconds: float  # on the host's clock
    measuring_s: float  # processor time of measuring, on the machine that ran this
    whole_host_lp: float  # what is truly enough with the first load alone, with as many VPs as the host has
    computed_s: float  # processor time of the whole component on the machine that ran this
    run_as: str  # the jobs of a long run, the budget and the loads
    provisional: int = 0  # of the first pass, in per cent of the same VPs; 0: none, or there is no first pass
    first_pass_s: float = 0.0  # on the host's clock

    @property
    def is_near(self) -> bool:
        """Whether the first pass came near the final answer."""
        return abs(self.provisional - self.reserve) <= max(NEAR_POINTS, NEAR_PART * self.reserve)

    @property
    def exists(self) -> bool:
        """Whether there is an answer that noise does not push beyond the host."""
        return self.truth <= self.highest - NEAR_WHOLE


RUN_AS = f"long runs of {JOBS:,} jobs, {BUDGET} a setting, with {', '.join(LOADS)}"


def answers(seed: int) -> list[Answer]:
    """Measure a component by every strategy."""
    began = time.process_time()
    with tempfile.TemporaryDirectory(dir=IN_MEMORY if Path(IN_MEMORY).is_dir() else None) as folder:
        place = Path(folder)
        drawn = draw(seed)
        runs = LongRuns(drawn, loaded(place / "used", drawn.manifest(drawn.used)), loads=LOADS, jobs=JOBS)
        drawn = leave_floor(drawn, runs, random.Random(f"floor/{seed}"))
        limit = limit_of(drawn, runs)
        wide = loaded(place / "wide", drawn.manifest(drawn.logical_processors))
        whole_host = LongRuns(drawn, wide, loads=LOADS[:1], jobs=JOBS // WHOLE_HOST_PART)
        whole_host_lp = whole_host.least(limit) * whole_host.processors / 100
        found = [
            _answer(name, runs, limit, loaded(place / name, drawn.manifest(limit=limit, slow_job=slow_job)))
            for name, (_, slow_job) in STRATEGIES.items()
        ]
    seconds = time.process_time() - began
    return [replace(answer, whole_host_lp=whole_host_lp, computed_s=seconds) for answer in found]


def loaded(folder: Path, manifest: str) -> Hosts:
    folder.mkdir()
    (folder / "rarms.yaml").write_text(manifest, encoding="utf-8")
    return rarms.load(str(folder / "rarms.yaml"))


def leave_floor(drawn: Drawn, runs: LongRuns, chance: random.Random) -> Drawn:
    """Draw another reservation below while the index is hardly worse a little below."""
    overloaded = math.ceil(100 * drawn.work_ms / drawn.every_ms / drawn.used) if drawn.every_ms else 0
    least = max(LESS + 1, overloaded + 1)
    at = drawn.reserve if drawn.reserve > 100 else min(drawn.reserve, runs.highest)
    while least < at <= 100 and runs.level(at - LESS) < WORSE * runs.level(at):
        at = chance.randint(least, at - 1)
    return replace(drawn, reserve=at)


def limit_of(drawn: Drawn, runs: LongRuns) -> float:
    """Return the level that the threshold asks for: of its reservation and up to a point below, or out of reach."""
    if drawn.reserve > 100:
        return 0.95 * runs.level(runs.highest)
    here, below = runs.level(drawn.reserve), runs.level(drawn.reserve - 1)
    return here + drawn.within * max(0.0, below - here)


def _answer(name: str, runs: LongRuns, limit: float, hosts: Hosts) -> Answer:
    began, strategy = time.process_time(), STRATEGIES[name][0]
    looks = rarms.measure(hosts, MeasureRequest(quick=True)).experiments if strategy == "default" else ()
    results = rarms.measure(hosts, MeasureRequest(strategy=strategy)).experiments
    measuring_s = time.process_time() - began
    end, truth = decisive(results), runs.least(limit)
    component = hosts.system.components[runs.drawn.name]
    [(index, threshold)] = component.apt.items()
    reserve = _of_used_processors(end, runs)
    logs = [log for result in results if (log := read_log(Path(result.log))) is not None]
    near_whole = max(1, runs.highest - NEAR_WHOLE)
    needs = [_samples_needed(index, threshold, series, limit, hosts) for series in runs.at(near_whole)]
    needs_ms = sum(1000 * count / rate_of(each) for count, each in zip(needs, runs.at(near_whole), strict=True))
    return Answer(
        strategy=name,
        component=component.name,
        index=index,
        ending=end.ending,
        processors=runs.processors,
        reserve=reserve,
        truth=truth,
        highest=runs.highest,
        is_wrong=_is_wrong(end, reserve, truth, limit, runs),
        is_conditional=any(result.conditions for result in results),
        needs=max(needs),
        is_short=max(needs) > MOST_SAMPLES or needs_ms > runs.experiments[0].budget.most_ms,
        settings=sum(len(log.recorded) for log in logs),
        seconds=sum(record.setting.host_ms for log in logs for _, record in log.recorded) / 1000,
        measuring_s=measuring_s,
        whole_host_lp=0.0,
        computed_s=0.0,
        run_as=RUN_AS,
        provisional=_of_used_processors(decisive(looks), runs) if looks else 0,
        first_pass_s=sum(
            record.setting.host_ms for log in logs for _, record in log.recorded if record.setting.first_pass
        )
        / 1000,
    )


def _of_used_processors(end: ExperimentResult, runs: LongRuns) -> int:
    """Return an answer in the VPs that it uses, had it been seen to use others; 0: there is none."""
    return 0 if end.reserve is None else math.ceil(end.reserve * end.processors / runs.processors)


def _is_wrong(end: ExperimentResult, reserve: int, truth: int, limit: float, runs: LongRuns) -> bool:
    """Whether long runs contradict what was said; they know a threshold that was drawn from them to about a point.

    Of a maximum it was said which share of jobs may lie beyond it, of a minimum that it was missed so far.
    """
    index = index_named(runs.drawn.index)
    if not reserve:
        return isinstance(end.conclusion, NotAchievable) and truth <= runs.highest and not index.is_extreme
    series = runs.at(min(reserve + 1, runs.highest))
    if index.name != "maximum_response_time":
        return max(level_of(index.name, each) for each in series) > limit * (1 + 1e-6)
    estimates = [each.indexes[0].estimate for each in end.measured if each.reserve == end.reserve]
    stated = max((each.beyond or 0.0 for each in estimates if each is not None), default=0.0) / 100
    times = [response_times(each.samples) for each in series]
    return max(sum(time > limit for time in each) / len(each) for each in times) > stated


def _samples_needed(index: str, threshold: Threshold, series: Series, limit: float, hosts: Hosts) -> int:
    """Return samples of a setting that show what is true in a long run."""
    least = samples_needed(index, threshold)
    if index == "success_rate":
        good = bytes(time <= limit * (1 + 1e-6) for time in response_times(series.samples))
        series = replace(series, samples=replace(columns_of(series.samples), successful=good, known={}))
    verdict = judge_look(series, {index: threshold}, run_of(hosts.system.components[series.component]))
    if not isinstance(verdict, WithinNoise):
        return least
    [judged] = verdict.judged
    return max(least, round(min(1e9, samples_to_clear(judged, series) or 0.0)))


def figures(found: Sequence[Answer]) -> Iterator[Figure]:
    """Of each strategy: wrong answers, components without one, how far answers lie above the truth, settings, time."""
    for strategy in STRATEGIES:
        of_strategy = [answer for answer in found if answer.strategy == strategy]
        own = [answer for answer in of_strategy if not answer.is_short]
        apart = [answer for answer in of_strategy if answer.is_short]
        answered = [answer for answer in own if answer.exists and answer.reserve]
        over = sorted(max(0, answer.reserve - answer.truth) for answer in answered)
        share_over = sorted(_percent(max(0, each.reserve - each.truth), each.truth) for each in answered)
        wrong, existing = sum(answer.is_wrong for answer in own), sum(answer.exists for answer in own)
        lowest, highest = (100 * each for each in share_interval(wrong, max(1, len(own)), error=0.1))

        def goal(most: float, strategy: str = strategy) -> float | None:
            return most if strategy == "default" else None

        yield Figure(name=f"{strategy}: {len(own)} components, wrong", value=_percent(wrong, len(own)), unit="%")
        yield Figure(name="  at least, by 95 %", value=lowest, unit="%", at_most=goal(100 * ERROR))
        yield Figure(name="  at most, by 95 %", value=highest, unit="%")
        no_answer = _percent(existing - len(answered), existing)
        yield Figure(name=f"  no answer, of {existing} that have one", value=no_answer, unit="%", at_most=goal(3))
        yield Figure(name="  points too high, mean", value=_mean(over), unit="", at_most=goal(1.5))
        yield Figure(name="    95th percentile", value=_p95(over), unit="", at_most=goal(6))
        yield Figure(name="  too high, mean", value=_mean(share_over), unit="% of the truth")
        yield Figure(name="    95th percentile", value=_p95(share_over), unit="% of the truth")
        conditional = _percent(sum(each.is_conditional for each in answered), len(answered))
        yield Figure(name="  met on a condition", value=conditional, unit="%")
        short = _percent(len(apart), len(of_strategy))
        yield Figure(name="  counted apart: too few samples in the budget", value=short, unit="%", at_most=goal(10))
        beyond = sum(answer.needs > MOST_SAMPLES for answer in apart)
        yield Figure(name=f"    of these more than {MOST_SAMPLES:,} needed", value=beyond, unit="")
        yield Figure(name="    of these answered", value=sum(answer.reserve > 0 for answer in apart), unit="")
        yield Figure(name="  reserved, each", value=_mean([_lp(each, each.reserve) for each in answered]), unit="LP")
        yield Figure(name="    truly enough", value=_mean([_lp(each, each.truth) for each in answered]), unit="LP")
        whole_host = _mean([each.whole_host_lp for each in answered])
        yield Figure(name=f"    with the host's number of VPs, with {LOADS[0]} alone", value=whole_host, unit="LP")
        yield Figure(name="  settings, each", value=_mean([each.settings for each in own]), unit="")
        minutes = {name: _minutes(found, name) for name in STRATEGIES}
        most = goal(minutes["bisection"])
        yield Figure(name="  time on the host, each", value=minutes[strategy], unit="min", at_most=most)
        yield Figure(name="  processor time, each", value=_mean([each.measuring_s for each in own]), unit="s")
    yield from _first_pass_figures([each for each in found if each.strategy == "default" and each.first_pass_s])
    computed = {answer.component: answer.computed_s / 3600 for answer in found}
    yield Figure(name="processor time of this run", value=sum(computed.values()), unit="h")
    yield Figure(name=f"  of {COMPONENTS} such components", value=COMPONENTS * _mean([*computed.values()]), unit="h")


def _first_pass_figures(found: Sequence[Answer]) -> Iterator[Figure]:
    minutes = sorted(answer.first_pass_s / 60 for answer in found)
    if not minutes:
        return
    both = [answer for answer in found if answer.provisional and answer.reserve]
    near = _percent(sum(answer.is_near for answer in both), len(both))
    yield Figure(name="first pass: time on the host, median", value=minutes[len(minutes) // 2], unit="min", at_most=2)
    late = minutes[math.ceil(0.9 * len(minutes)) - 1]
    yield Figure(name="  90th percentile", value=late, unit="min", at_most=5)
    name = f"  further than 10 % or {NEAR_POINTS} points from the final answer, of {len(both)}"
    yield Figure(name=name, value=100 - near if both else 0.0, unit="%", at_most=20)


def _why_far(answer: Answer) -> str:
    """Return why few jobs hardly show an index."""
    if index_named(answer.index).is_extreme:
        return "an extreme of few jobs lies nearer than one of many"
    if answer.index in {"success_rate", "deadline_miss_rate"}:
        return "few jobs hardly show a share of jobs"
    if percentile_of(answer.index) is not None:
        return "few jobs lie beyond the percentile"
    return "its estimate lay on the wrong side of the threshold, or the final bound is wide"


def _minutes(found: Sequence[Answer], strategy: str) -> float:
    return _mean([answer.seconds / 60 for answer in found if answer.strategy == strategy and not answer.is_short])


def _lp(answer: Answer, reserve: int) -> float:
    return reserve * answer.processors / 100


def _p95(ordered: Sequence[float]) -> float:
    return ordered[math.ceil(0.95 * len(ordered)) - 1] if ordered else 0.0


def _mean(values: Sequence[float]) -> float:
    return fmean(values) if values else 0.0


def _percent(part: int, whole: int) -> float:
    return 100 * part / max(1, whole)


def main() -> int:
    """Print the table; 1 where a goal is missed."""
    first, last = map(int, sys.argv[1:3]) if len(sys.argv) > 2 else (0, COMPONENTS - 1)
    file = Path(sys.argv[3] if len(sys.argv) > 3 else os.devnull)
    lines = file.read_text(encoding="utf-8").splitlines() if file.exists() else []
    names = [f"c{seed}" for seed in range(first, last + 1)]
    known = [answer for answer in (Answer(**json.loads(line)) for line in lines) if answer.run_as == RUN_AS]
    found = [answer for answer in known if answer.component in names]
    missing = [int(name[1:]) for name in names if name not in {answer.component for answer in found}]
    print(f"components {first} to {last} of {COMPONENTS}, {RUN_AS}")
    with Pool(PROCESSES) as pool, file.open("a", encoding="utf-8") as written:
        for several in pool.imap_unordered(answers, missing):
            found += several
            written.writelines(f"{json.dumps(asdict(answer))}\n" for answer in several)
            written.flush()
    for answer in found:
        if answer.is_wrong or not answer.reserve or answer.reserve - answer.truth > 6:
            kind = "WRONG" if answer.is_wrong else "counted apart" if answer.is_short else "no answer or far"
            print(
                f"{answer.component} ({answer.strategy}, {answer.index}): {kind}: {answer.ending}, "
                f"{answer.reserve} % found, {answer.truth} % true, the host can give {answer.highest} %"
            )
        if answer.strategy == "default" and answer.provisional and answer.reserve and not answer.is_near:
            print(
                f"{answer.component} ({answer.index}): first pass {answer.provisional} %, in the end "
                f"{answer.reserve} %: {_why_far(answer)}"
            )
    return report([*figures(found)])


if __name__ == "__main__":
    sys.exit(main())
