"""The loop of measuring, on a host whose answers are known by hand: 40 ms of work at 50 % take 80 ms."""

import json
import tempfile
from collections.abc import Iterator, Mapping, Sequence
from contextlib import chdir
from dataclasses import dataclass, replace
from pathlib import Path

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from rarms_iac.manifest.text.tree import first_line
from rarms_iac.measuring.evidence import shortfall_at, why_unsteady
from rarms_iac.measuring.findings import findings_of
from rarms_iac.measuring.measure_request import ExperimentResult
from rarms_iac.measuring.search.trials import is_clear
from rarms_iac.measuring.strategies import SettingCount, Sweep, goal_of
from rarms_iac.model.experiment import Experiment, experiment_of
from rarms_iac.model.outcomes import (
    Measure,
    Missed,
    NotAchievable,
    NotResolved,
    SettingFailed,
    Stopped,
    Sufficient,
    Unsteady,
)
from rarms_iac.model.run import SampleCount
from rarms_iac.model.setting import P1, P2, Setting, SettingEvidence
from rarms_iac.model.system import Threshold
from rarms_iac.providers.simulated.measuring import Simulate, SimulatedRun
from rarms_iac.providers.simulated.scheduling.machine import JobDone, ModelMachine
from rarms_iac.providers.simulated.scheduling.simulation import SchedulerSimulation
from rarms_iac.statistics.curves import curves_of, least_reserve
from tests.builders import a_component, a_run, a_simulation, a_system, at_most
from tests.builders_measured import a_series
from tests.effort import examples
from tests.fluid import fluid
from tests.measuring import rewrite_log, the_log
from tests.unit.cli.running import rarms
from tests.unit.measuring.bench import Bench

SYSTEM = a_system(
    components=[
        a_component(
            "vision",
            apt={"mean_response_time": at_most(84)},
            run=a_run(until=SampleCount(samples=400)),
            simulation=a_simulation(work="40 ms", varies="2 %"),
        ),
        a_component(
            "speech",
            apt={"mean_response_time": at_most(200)},
            run=a_run(until=SampleCount(samples=400)),
            simulation=a_simulation(work="40 ms", varies="2 %"),
        ),
    ]
)


def an_experiment(*members: str) -> Experiment:
    return experiment_of(SYSTEM, SYSTEM.hosts["onboard"], members or ("vision",), "busy-loop")


@pytest.fixture
def bench(tmp_path: Path) -> Bench:
    return Bench(tmp_path, an_experiment())


@dataclass(frozen=True, slots=True)
class Endless:
    """Asks for one setting after the other, with any result."""

    asked: Sequence[int]

    def decide(self, settings: Sequence[Setting]) -> Measure:
        return Measure(reserve=self.asked[len(settings)], until_clear=True)


@given(asked=st.permutations(range(10, 101, 5)), most=st.integers(1, 6))
@settings(max_examples=examples(8), deadline=None)
def test_search_is_short_and_equals_the_plan(asked: list[int], most: int) -> None:
    with tempfile.TemporaryDirectory() as folder:
        bench = Bench(Path(folder), an_experiment())
        ended = bench.measure(Endless(asked), count=SettingCount(least=1, most=most, ends_early=True))
        goal = goal_of(bench.experiment)
        least = least_reserve(curves_of(ended.settings, goal.runs, goal.apts))

    assert ended.new == len(ended.settings) == most
    if least is None:
        assert isinstance(ended.conclusion, NotResolved)
        assert max(asked[:most]) < 50
        assert ended.conclusion.more_settings == most
    else:
        assert isinstance(ended.conclusion, Sufficient)
        assert ended.conclusion.reserve == least == min(reserve for reserve in asked[:most] if reserve >= 50)
        below = least - 1 - (ended.conclusion.failed or 0)  # whole per cents that are not known to be too little
        assert ended.conclusion.more_settings == max(1, min(most, below))


def test_search_finds_percent_above_a_fail(bench: Bench) -> None:
    ended = bench.measure()

    assert isinstance(ended.conclusion, Sufficient)
    assert 47 <= ended.conclusion.reserve <= 49
    assert ended.conclusion.failed == ended.conclusion.reserve - 1
    assert ended.new == len(bench.recorded)


def counted(load: float) -> SettingEvidence:
    """What a kernel counts where the load got so many LPs."""
    return SettingEvidence(elapsed_ms=1000, cpu_ms={P1: 500.0, P2: 1000 * load})


def counting(monkeypatch: pytest.MonkeyPatch, loads: Sequence[float]) -> None:
    """Each try comes with the next count."""
    counts = iter(map(counted, loads))
    monkeypatch.setattr(SimulatedRun, "evidence", lambda _running: next(counts))


def test_disturbed_setting_is_measured_again_and_says_so(bench: Bench, monkeypatch: pytest.MonkeyPatch) -> None:
    counting(monkeypatch, [0.2, 1.0])

    ended = bench.measure(Sweep(reserves=(50,)))

    (setting,) = ended.settings
    assert len(bench.ran) == 2
    assert setting.evidence == replace(
        counted(1.0), disturbances=("the load in P2 got 0.20 LP of its reserved 1.00 LP",)
    )
    assert not setting.series[0].unsettled
    assert bench.book.known.settings == (setting,)


def test_thrice_disturbed_setting_has_no_verdict(bench: Bench, monkeypatch: pytest.MonkeyPatch) -> None:
    counting(monkeypatch, [0.2, 0.3, 0.4])

    ended = bench.measure(Sweep(reserves=(50,)))

    (setting,) = ended.settings
    assert setting.evidence is not None
    assert len(bench.ran) == len(setting.evidence.disturbances) == 3
    assert setting.series[0].unsettled.startswith("disturbed in each of 3 tries: the load in P2 got 0.40 LP")


def test_papers_walk_ignores_other_settings(bench: Bench) -> None:
    bench.measure(Sweep(reserves=(20, 45, 90)))
    bench.ran.clear()
    ended = bench.measure(bench.search("paper"))

    assert ended.conclusion == Sufficient(reserve=50, failed=40)
    assert bench.ran == [10, 30, 40, 50]


def test_search_stays_within_what_host_can_give(bench: Bench) -> None:
    assert bench.measure(bench.search(most=45)).conclusion == NotAchievable(reserve=45)
    assert max(bench.ran) == 45


def test_all_members_must_meet_thresholds(tmp_path: Path) -> None:
    bench = Bench(tmp_path, an_experiment("speech", "vision"))
    ended = bench.measure(bench.search("paper"))

    assert ended.conclusion == Sufficient(reserve=50, failed=40)
    assert [series.component for series in ended.settings[0].series] == ["speech", "vision"]


def test_p1_has_the_planned_task_classes(tmp_path: Path) -> None:
    bench = Bench(tmp_path, an_experiment("speech", "vision"))
    speech, vision = bench.experiment.members
    bench.experiment = replace(
        bench.experiment,
        members=(
            replace(speech, task="SpeechRecognition", criticality=10),
            replace(vision, task="ObjectIdentification", criticality=40),
        ),
    )
    priorities: dict[str, int] = {}

    def looking(machine: ModelMachine, seed: int) -> Iterator[JobDone]:
        priorities.update(
            {component.component: component.priority for each in machine.machines for component in each.components}
        )
        return fluid(machine, seed)

    bench.measure(Sweep(reserves=(50,)), simulate=looking)

    assert priorities["vision"] > priorities["speech"] > 16


def test_search_ends_with_a_measured_reservation(bench: Bench) -> None:
    """Each threshold lies another part of a point from where the search decides."""
    for threshold in (80, 81, 82, 83, 84, 85):
        vision = replace(an_experiment().members[0], apt={"mean_response_time": at_most(threshold)})
        bench.experiment = replace(an_experiment(), members=(vision,))
        ended = bench.measure(bench.search("default"))
        curves = curves_of(ended.settings, bench.experiment.runs, {"vision": vision.apt})

        assert isinstance(ended.conclusion, Sufficient)
        assert least_reserve(curves) == ended.conclusion.reserve
        assert ended.conclusion.reserve in bench.recorded


def test_threshold_at_floor_is_never_met_for_sure(bench: Bench) -> None:
    """A plan could reserve nothing for it: so measuring says that, too, and not that it is not achievable."""
    vision = replace(an_experiment().members[0], apt={"mean_response_time": at_most("83.5")})
    bench.experiment = replace(an_experiment(), members=(vision,))

    def flat(machine: ModelMachine, seed: int) -> Iterator[JobDone]:
        reserve = max(vm.reserve for vm in machine.machines if vm.components)
        for number, job in enumerate(fluid(machine, seed)):
            yield replace(job, response=168.0 if reserve < 60 else 85.5 if number % 2 else 81.5)

    ended = bench.measure(bench.search("default"), simulate=flat)

    assert isinstance(ended.conclusion, NotResolved)
    assert ended.conclusion.reason.startswith(
        "at 100 % of its VPs vision neither met nor missed its threshold with 99 % confidence"
    )
    other = Bench(bench.folder / "other", bench.experiment)
    other.folder.mkdir()
    within = other.measure(other.search("bisection", most=80), simulate=flat)
    assert isinstance(within.conclusion, NotResolved)
    assert within.conclusion.reason.startswith(
        "at 80 % of its VPs vision neither met nor missed its threshold with 99 % confidence"
    )


def test_too_many_failures_end_without_verdict(bench: Bench) -> None:
    def dying(machine: ModelMachine, seed: int) -> Iterator[JobDone]:
        for number, job in enumerate(fluid(machine, seed)):
            yield replace(job, answered=False) if number == 7 else job

    ended = bench.measure(simulate=dying)

    assert isinstance(ended.conclusion, SettingFailed)
    assert ended.conclusion.verdict.component == "vision"
    assert "no answer within" in ended.conclusion.verdict.failures[0]
    assert bench.recorded == []
    assert bench.machines == []


def test_stop_drops_running_setting_and_resumes(bench: Bench) -> None:
    looks = iter(range(1_000_000))
    stopped = bench.measure(bench.search("paper"), should_stop=lambda: next(looks) > 150)

    assert stopped.conclusion == Stopped()
    assert bench.recorded == [10, 20][: len(bench.recorded)]
    assert bench.machines == []
    before = list(bench.recorded)
    bench.ran.clear()
    assert bench.measure(bench.search("paper")).conclusion == Sufficient(reserve=50, failed=40)
    assert bench.ran == [level for level in (10, 20, 30, 40, 50) if level not in before]


def test_met_maximum_is_watched_to_the_end(bench: Bench) -> None:
    apt: dict[str, Threshold] = {"maximum_response_time": at_most(100)}
    vision = replace(bench.experiment.members[0], apt=apt, run=a_run())
    bench.experiment = replace(bench.experiment, members=(vision,))
    ended = bench.measure()

    counts = {setting.reserve: len(setting.series[0].samples) for setting in ended.settings}
    assert isinstance(ended.conclusion, Sufficient)
    assert counts[ended.conclusion.reserve] >= 200 > min(counts.values())


def test_early_end_is_remeasured_for_new_threshold(bench: Bench) -> None:
    vision = replace(bench.experiment.members[0], run=a_run())
    bench.experiment = replace(bench.experiment, members=(replace(vision, apt={"mean_response_time": at_most(20)}),))
    assert isinstance(bench.measure().conclusion, NotAchievable)
    short = {setting.reserve: len(setting.series[0].samples) for setting in bench.measure().settings}
    bench.experiment = replace(bench.experiment, members=(replace(vision, apt={"maximum_response_time": at_most(84)}),))
    ended = bench.measure()

    counts = {setting.reserve: len(setting.series[0].samples) for setting in ended.settings}
    assert isinstance(ended.conclusion, Sufficient)
    assert short[100] < 200 <= counts[ended.conclusion.reserve]
    assert len(counts) == len(ended.settings), "of a setting that was measured again, the longer counts"
    assert bench.measure().new == 0


def test_first_setting_is_as_precise_as_asked(bench: Bench) -> None:
    vision = replace(bench.experiment.members[0], apt={"mean_response_time": at_most(200)}, run=a_run(until=None))
    bench.experiment = replace(bench.experiment, members=(vision,))
    asked = bench.search("default").decide(())
    jobs = [72.0 if number % 2 else 88.0 for number in range(200)]
    few, many = (Setting(reserve=45, series=(a_series("vision", jobs[:count]),)) for count in (40, 160))

    assert isinstance(asked, Measure)
    assert is_clear(few, goal_of(bench.experiment))
    assert not is_clear(few, goal_of(bench.experiment), precision=asked.precision)
    assert is_clear(many, goal_of(bench.experiment), precision=asked.precision)


def test_log_gives_the_same_decisions(bench: Bench) -> None:
    """Early ends are decided while samples come in, and judged again from what was recorded."""
    ended = bench.measure()
    replayed = bench.search().decide(bench.book.known.settings)

    assert replayed == ended.conclusion


MANIFEST = """\
schema: rarms/v1
application: { name: robot }
hosts:
  onboard: { logical_processors: 4, memory: 4 GiB }
components:
  eyes:
    criticality: 3
    apt: { mean_response_time: { at_most: 50 ms } }
    interference: busy-loop
    run: { command: [eyes], until: { samples: 40 } }
    memory: 256 MiB
    simulation: { work: 20 ms, threads: THREADS }
"""
LOG = Path("measurements/onboard/eyes/busy-loop.jsonl")


@pytest.fixture
def manifest(tmp_path: Path) -> Path:
    path = tmp_path / "rarms.yaml"
    path.write_text(MANIFEST.replace("THREADS", "1"), encoding="utf-8", newline="\n")
    return path


def recorded() -> list[tuple[int, int | None]]:
    """Of each setting of the log its virtual processors, and how many were used at once."""
    return [(each.setting.processors, each.setting.used_processors) for each in the_log(LOG).recorded]


@pytest.mark.parametrize(("threads", "used"), [(1, 1), (2, 2), (6, 4)])
def test_first_setting_shows_used_processors(threads: int, used: int, manifest: Path) -> None:
    manifest.write_text(MANIFEST.replace("THREADS", str(threads)), encoding="utf-8", newline="\n")
    with chdir(manifest.parent):
        measured = json.loads(rarms("measure", "--json").out)["experiments"][0]
        settings = recorded()
        again = json.loads(rarms("measure", "--json").out)["experiments"][0]
        while again["new"]:  # the first run ended at as many settings as there may be, and the same command goes on
            again = json.loads(rarms("measure", "--json").out)["experiments"][0]
        planned = json.loads(rarms("plan", "--json").out)

    assert settings[0] == (4, used)
    assert {processors for processors, _ in settings[1:]} == {used}
    assert (measured["processors"], measured["processors_from"]) == (used, "used")
    assert again["processors"] == used
    assert again["reserve"] <= measured["reserve"]
    assert f'"processors": {used}' in json.dumps(planned)


def test_fixed_processors_stay_and_are_noted(manifest: Path) -> None:
    fixed = manifest.read_text(encoding="utf-8").replace("    memory", "    processors: 2\n    memory")
    with chdir(manifest.parent):
        manifest.write_text(fixed, encoding="utf-8", newline="\n")
        ran = rarms("measure")
        settings = recorded()
        manifest.write_text(MANIFEST.replace("THREADS", "1"), encoding="utf-8", newline="\n")
        left_open = json.loads(rarms("measure", "--json").out)["experiments"][0]

    assert "RARMS380" in ran.err
    assert set(settings) == {(2, 1)}
    assert left_open["processors"] == 1


def test_papers_strategy_keeps_the_hosts_number(manifest: Path) -> None:
    with chdir(manifest.parent):
        measured = json.loads(rarms("measure", "--strategy", "paper", "--json").out)["experiments"][0]
        settings = recorded()
        planned = rarms("explain", "eyes").out

    assert (measured["processors"], measured["processors_from"]) == (4, "host")
    assert set(settings) == {(4, None)}
    assert "4 virtual processors all processors of the host" in " ".join(planned.split())


def test_later_growth_is_measured_with_more_processors(manifest: Path) -> None:
    """The program is the same for rarms: a log that holds says 1, and now 2 threads run at once."""
    with chdir(manifest.parent):
        rarms("measure")
        before = recorded()
        manifest.write_text(MANIFEST.replace("THREADS", "2"), encoding="utf-8", newline="\n")
        lines = LOG.read_text(encoding="utf-8")
        rarms("measure")  # stale: measured again, of two threads
        after = recorded()

    assert before[0] == (4, 1)
    assert '"threads"' not in lines.splitlines()[0]
    assert after[: len(before)] == before
    assert after[len(before)] == (4, 2)


def test_growing_use_begins_a_new_curve(
    manifest: Path,
) -> None:
    """What a log says was seen of two threads is one processor: the next setting shows two."""
    manifest.write_text(MANIFEST.replace("THREADS", "2"), encoding="utf-8", newline="\n")
    with chdir(manifest.parent):
        rarms("measure", "--from", "40%", "--to", "40%")
        rewrite_log(LOG, lambda each: replace(each, setting=replace(each.setting, processors=1, used_processors=1)))
        ran = rarms("measure")
        seen = recorded()

    assert "eyes uses 2 processors; measuring with 2 VPs instead of 1." in " ".join(ran.err.split())
    assert {processors for processors, used in seen if used == 2} == {1, 2}
    of_two = [processors for processors, _ in seen if processors == 2]
    assert len(of_two) <= 8


GROWS = 0.001
"""The part by which a job takes longer than the one before."""
FIRST, NEAR = range(41, 50), range(47, 56)


def an_unsteady_experiment(work: str, varies: str, limit: int) -> Experiment:
    component = a_component(
        "coi",
        apt={"mean_response_time": at_most(limit)},
        run=a_run(),
        simulation=a_simulation(work=work, varies=varies),
        reserve=None,
        processors=2,
    )
    system = a_system(components=[component])
    return experiment_of(system, system.hosts["onboard"], ("coi",), "busy-loop")


def growing(reserves: range) -> Simulate:
    """The fluid model, but for what is said above of these reservations of P1."""

    def simulate(machine: ModelMachine, seed: int) -> Iterator[JobDone]:
        [reserve] = [each.reserve for each in machine.machines if each.components]
        later = 0.0
        for number, job in enumerate(fluid(machine, seed)):
            longer = GROWS * number * job.response if reserve in reserves else 0.0
            yield replace(job, began=job.began + later, response=job.response + longer)
            later += longer

    return simulate


def searched(
    experiment: Experiment, folder: Path, silent: range = FIRST, scheduler: Simulate | None = None
) -> ExperimentResult:
    bench = Bench(folder, experiment)
    return bench.measure(bench.search("default"), simulate=scheduler or growing(silent))


def unsteady(settings: tuple[Setting, ...]) -> set[int]:
    return {setting.reserve for setting in settings if any(map(why_unsteady, setting.series))}


FAR_BELOW: Mapping[str, tuple[str, str, int, int]] = {
    "15 ms for 100 ms": ("15 ms", "10 %", 100, 15),
    "10 ms for 90 ms": ("10 ms", "10 %", 90, 12),
    "14 ms for 93 ms": ("14 ms", "5 %", 93, 15),
    "16 ms for 80 ms": ("16 ms", "5 %", 80, 20),
}
"""Work, how it varies, threshold in ms, and the CR that the work alone needs."""


@pytest.mark.parametrize("case", FAR_BELOW)
def test_first_setting_without_steady_state_costs_no_reservation(case: str, tmp_path: Path) -> None:
    work, varies, limit, needed = FAR_BELOW[case]
    experiment = an_unsteady_experiment(work, varies, limit)
    ended = searched(experiment, tmp_path)

    assert unsteady(ended.settings) <= {45}
    assert isinstance(ended.conclusion, Sufficient)
    assert needed <= ended.conclusion.reserve <= needed + 2
    assert ended.conclusion.failed is not None
    assert ended.conclusion.reserve - ended.conclusion.failed <= 3
    assert not isinstance(shortfall_at(ended.conclusion.failed, ended.settings, experiment), Unsteady)
    assert ended.conclusion.inconclusive == ()
    assert len(ended.settings) <= 9
    found = findings_of(experiment, ended.conclusion, ended.settings, first_line(""))
    assert "RARMS267" not in {finding.code for finding in found}


def test_unsteady_neighbourhood_is_unknown(tmp_path: Path) -> None:
    experiment = an_unsteady_experiment("15 ms", "10 %", 28)
    ended = searched(experiment, tmp_path, NEAR)
    end = ended.conclusion

    assert isinstance(end, Sufficient)
    assert end.inconclusive
    assert set(end.inconclusive) <= unsteady(ended.settings)
    assert end.failed not in unsteady(ended.settings)
    assert all((end.failed or 0) < level < end.reserve for level in end.inconclusive)
    found = findings_of(experiment, end, ended.settings, first_line(""))
    (told,) = [finding for finding in found if finding.code == "RARMS267"]
    assert f"coi: {end.reserve} % of its VPs is enough" in told.detail
    assert f"coi at {end.inconclusive[-1]} % of its VPs: its response times still changed within" in told.detail
    assert str(told.advice) == "Check coi for a growing queue. It is safe to ignore this."


def test_first_quick_jobs_are_not_believed(tmp_path: Path) -> None:
    """40 samples of 3 ms are over before the load beside them has missed anything: 1 % seemed enough, for 303 ms."""
    experiment = an_unsteady_experiment("3 ms", "0 %", 4)
    log = tmp_path / "settled"
    log.mkdir()
    ended = searched(experiment, log, scheduler=SchedulerSimulation)

    assert isinstance(ended.conclusion, Sufficient)
    assert ended.conclusion.reserve >= 35
    lower = [setting for setting in ended.settings if setting.reserve < 30]
    assert all(isinstance(shortfall_at(setting.reserve, ended.settings, experiment), Missed) for setting in lower)
