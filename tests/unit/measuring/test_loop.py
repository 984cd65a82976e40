"""The loop of measuring, on a host whose answers are known by hand: 40 ms of work at 50 % take 80 ms."""

import tempfile
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from pathlib import Path

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from rarms_iac.measuring.search.trials import is_clear
from rarms_iac.measuring.strategies import SettingCount, Sweep, goal_of
from rarms_iac.model.environment_setup import P1, P2
from rarms_iac.model.experiment import Experiment, experiment_of
from rarms_iac.model.outcomes import Measure, NotAchievable, NotResolved, SettingFailed, Stopped, Sufficient
from rarms_iac.model.run import SampleCount
from rarms_iac.model.setting import Setting, SettingEvidence
from rarms_iac.model.system import Threshold
from rarms_iac.providers.simulated.measuring import SimulatedRun
from rarms_iac.providers.simulated.scheduling.machine import JobDone, ModelMachine
from rarms_iac.statistics.curves import curves_of, least_reserve
from tests.builders import a_component, a_run, a_simulation, a_system, at_most
from tests.builders_measured import a_series
from tests.effort import examples
from tests.fluid import fluid
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
        counted(1.0), disturbances=("the load in P2 got 0.20 LP where 1.00 are reserved",)
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
    assert ended.conclusion.reason.startswith("at 100 % of its VPs vision is neither shown")
    other = Bench(bench.folder / "other", bench.experiment)
    other.folder.mkdir()
    within = other.measure(other.search("bisection", most=80), simulate=flat)
    assert isinstance(within.conclusion, NotResolved)
    assert within.conclusion.reason.startswith("at 80 % of its VPs vision is neither shown")


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
    jobs = [76.0 if number % 2 else 84.0 for number in range(200)]
    few, many = (Setting(reserve=45, series=(a_series("vision", jobs[:count]),)) for count in (40, 160))

    assert isinstance(asked, Measure)
    assert is_clear(few, goal_of(bench.experiment))
    assert not is_clear(few, goal_of(bench.experiment), precision=asked.precision)
    assert is_clear(many, goal_of(bench.experiment), precision=asked.precision)


def test_log_gives_the_same_decisions(bench: Bench) -> None:
    """Early ends are decided while samples come in, and judged anew from what was recorded."""
    ended = bench.measure()
    replayed = bench.search().decide(bench.book.known.settings)

    assert replayed == ended.conclusion
