"""Several loads: the first has a search, each further one confirms the answer or raises it."""

import json
from collections.abc import Mapping, Sequence
from contextlib import chdir
from dataclasses import dataclass, field, replace
from pathlib import Path

import pytest

import rarms_iac
from rarms_iac.app.declared_hosts import totals_at_hand
from rarms_iac.measuring.each_load import by_partition, decisive, next_experiment, with_result
from rarms_iac.measuring.measure_request import ExperimentResult, MeasureRequest, experiments_of_request
from rarms_iac.measuring.passes import begin_with_decisive
from rarms_iac.measuring.strategies import Method, Search, Sweep
from rarms_iac.model.experiment import Experiment, experiment_of
from rarms_iac.model.outcomes import Conclusion, NotAchievable, RareSlowJobs, Stopped, Sufficient, Swept
from rarms_iac.model.setting import P1, P2, OutsideWork, SettingEvidence
from rarms_iac.providers.simulated.measuring import SimulatedRun
from rarms_iac.storage.datalog.log import Recorded
from tests.builders import a_component, a_host, a_system
from tests.measuring import leave_logs, rewrite_log, the_log, with_weak_load
from tests.unit.cli.running import rarms

SYSTEM = a_system(hosts=[a_host(), a_host("other")], components=[a_component("vision"), a_component("speech")])
LOADS = ("busy-loop", "bursts-20", "bursts-100")


def experiments(*loads: str, host: str = "onboard", member: str = "vision") -> tuple[Experiment, ...]:
    return tuple(experiment_of(SYSTEM, SYSTEM.hosts[host], (member,), load) for load in loads)


@dataclass
class Needs:
    """Answers at once: beside each load so many per cent are enough, and it notes from where it was asked."""

    least: Mapping[str, int]  # 0: nothing is enough
    asked: list[tuple[str, int]] = field(default_factory=list)
    conditional: frozenset[str] = frozenset()  # loads beside which the answer has a condition, which stays

    def run(self, experiment: Experiment, method: Method) -> ExperimentResult:
        load = experiment.setup.interference
        floor = method.floor if isinstance(method, Search) else -1
        self.asked.append((load, floor))
        needed = max(floor, self.least[load])
        end: Conclusion = Sufficient(reserve=needed, failed=None) if self.least[load] else NotAchievable(reserve=100)
        if isinstance(method, Sweep):
            end = Swept()
        planned = self.least[load]
        conditions = (RARE,) if load in self.conditional else ()
        return ExperimentResult(
            experiment=experiment,
            conclusion=end,
            settings=(),
            run_now=frozenset({1}),
            planned=planned,
            conditions=conditions,
            log=load,
        )


RARE = RareSlowJobs(component="vision", index="mean_response_time", slower_than_ms=30.0, once_in=400)
SEARCH = Search()


def measure(needs: Needs, method: Method = SEARCH) -> Sequence[ExperimentResult]:
    loads = experiments(*LOADS)
    results: tuple[ExperimentResult, ...] = ()
    while (asked := next_experiment(loads, results, method)) is not None:
        results = with_result(loads, results, needs.run(*asked))
    return results


def test_each_load_begins_with_the_answer() -> None:
    needs = Needs({"busy-loop": 30, "bursts-20": 42, "bursts-100": 37})

    results = measure(needs)

    assert needs.asked == [("busy-loop", 0), ("bursts-20", 30), ("bursts-100", 42)]
    assert [(result.so_far, result.reserve) for result in results] == [(None, 30), (30, 42), (42, 42)]
    assert decisive(results).interference == "bursts-20"


def test_conditions_at_the_answer_are_measured_further_once() -> None:
    needs = Needs({"busy-loop": 30, "bursts-20": 42, "bursts-100": 37}, conditional=frozenset(LOADS))

    results = measure(needs)

    assert needs.asked[3:] == [("bursts-20", 42), ("bursts-100", 42)], "with the busy loop less was enough"
    assert [result.is_confirmed for result in results] == [False, True, True]


def test_answer_that_is_not_confirmed_is_searched_again() -> None:
    needs = Needs({"busy-loop": 30, "bursts-20": 42, "bursts-100": 37}, conditional=frozenset({"bursts-20"}))
    loads = experiments(*LOADS)
    results = measure(Needs(needs.least))
    results = tuple(replace(each, conditions=(RARE,)) for each in results)
    asked = next_experiment(loads, results, SEARCH)
    assert asked is not None
    needs.least = {**needs.least, "bursts-20": 44}

    results = with_result(loads, results, needs.run(*asked))

    assert [result.reserve for result in results] == [30, 44]
    assert next_experiment(loads, results, SEARCH) == (loads[2], replace(SEARCH, floor=44))


def test_without_answer_no_load_confirms() -> None:
    needs = Needs({"busy-loop": 30, "bursts-20": 0, "bursts-100": 37})

    results = measure(needs)

    assert needs.asked == [("busy-loop", 0), ("bursts-20", 30)]
    assert decisive(results).conclusion == NotAchievable(reserve=100)


def test_end_while_confirming_keeps_the_answer() -> None:
    needs = Needs({"busy-loop": 30, "bursts-20": 42, "bursts-100": 37})
    loads = experiments(*LOADS)
    results = tuple(replace(each, conditions=(RARE,)) for each in measure(needs))
    stopped = replace(results[1], conclusion=Stopped(), conditions=())

    ended = with_result(loads, results, stopped)

    assert decisive(ended).reserve == 42
    assert decisive(ended).conditions == (RARE,)
    assert [each.stopped for each in ended] == [False, True, False]
    assert next_experiment(loads, ended, SEARCH) is None


def test_asked_end_leaves_other_loads() -> None:
    loads = experiments(*LOADS)
    stopped = ExperimentResult(
        experiment=loads[0], conclusion=Stopped(), settings=(), run_now=frozenset(), planned=None, log="log"
    )

    assert next_experiment(loads, [stopped], Search()) is None


def test_sweep_shows_the_hardest_load() -> None:
    needs = Needs({"busy-loop": 30, "bursts-20": 42, "bursts-100": 37})

    results = measure(needs, Sweep(reserves=(40, 50)))

    assert [load for load, _ in needs.asked] == [*LOADS]
    assert decisive(results).interference == "bursts-20"


def test_experiments_that_differ_in_load_alone_belong_together() -> None:
    groups = [
        experiments(*LOADS),
        experiments("busy-loop", host="other"),
        experiments("busy-loop", "bursts-20", member="speech"),
    ]

    assert list(by_partition([each for group in groups for each in group])) == groups


MANIFEST = """\
schema: rarms/v1
application: { name: robot }
hosts:
  onboard: { logical_processors: 1, memory: 4 GiB }
components:
  a:
    criticality: 30
    apt: { mean_response_time: { at_most: 6 ms } }
    run: { command: [a], arrival: { every: 50 ms }, until: { samples: 300 } }
    simulation: { work: 5 ms }
policy: { interference: [busy-loop, bursts-100] }
"""
"""One of the pair that misses, measured beside the load that never pauses alone: 11 % are enough for it there."""


def test_several_loads_give_the_planned_reservation(tmp_path: Path) -> None:
    (tmp_path / "rarms.yaml").write_text(MANIFEST, encoding="utf-8")
    with chdir(tmp_path):
        ran = rarms("measure", "--json")
        again = rarms("measure", "-v")
        planned = rarms("plan", "--json")
        explained = rarms("explain", "a")

    bursts, busy = json.loads(ran.out)["experiments"]
    assert (bursts["interference"], bursts["so_far"]) == ("bursts-100", None), "the load of the first pass"
    assert (busy["interference"], busy["so_far"]) == ("busy-loop", bursts["reserve"])
    assert busy["reserve"] == bursts["reserve"] > 12
    assert [each["reserve"] for each in busy["measured"]] == [bursts["reserve"]], "a further load is asked to confirm"
    assert "all of them by an earlier run" in again.out
    (onboard,) = json.loads(planned.out)["hosts"]
    assert [change["reserved_lp"] for change in onboard["changes"]] == [bursts["reserve"] / 100]
    assert "load bursts-100 needs the most; busy-loop need no more" in " ".join(explained.out.split())


def test_one_missing_log_prevents_the_plan(tmp_path: Path) -> None:
    (tmp_path / "rarms.yaml").write_text(MANIFEST.replace("at_most: 6 ms", "at_most: 60 ms"), encoding="utf-8")
    leave_logs(tmp_path, {"a": 12})
    (tmp_path / "measurements" / "onboard" / "a" / "bursts-100.jsonl").unlink()
    with chdir(tmp_path):
        planned = rarms("plan")

    assert planned.code != 0
    assert "is not measured with bursts-100 yet" in " ".join(planned.err.split())


CONTROL_LOOP = """\
schema: rarms/v1
application: { name: robot }
hosts:
  onboard: { logical_processors: 2, memory: 4 GiB }
components:
  control-loop:
    criticality: 20
    apt: { p95_response_time: { at_most: 12 ms } }
    run: { command: [a], arrival: { every: 20 ms } }
    simulation: { work: 4.4 ms, varies: 5 % }
    processors: 2
policy: { interference: [busy-loop, bursts-20, bursts-100], measuring: { setting: 60 s } }
"""
"""34 s are the least: 30 starts of the busy loop, and 164 samples beside each. With 13 s each it had no answer."""


def test_sufficient_budget_finds_the_same(tmp_path: Path) -> None:
    reserves = []
    for name, setting in (("short", "60 s"), ("long", "3 min")):
        (tmp_path / name).mkdir()
        (tmp_path / name / "rarms.yaml").write_text(CONTROL_LOOP.replace("60 s", setting), encoding="utf-8")
        with chdir(tmp_path / name):
            ran = rarms("measure", "--json")
        assert ran.code == 0, ran.err
        reserves.append([each["reserve"] for each in json.loads(ran.out)["experiments"]])

    short, long = reserves
    assert [abs(reserve - wanted) <= 2 for reserve, wanted in zip(short, long, strict=True)] == [True, True, True]


LIGHT = MANIFEST.replace("logical_processors: 1", "logical_processors: 2").replace(
    "[busy-loop, bursts-100] }", "[light] }\ninterference: { light: { kind: busy_loop, threads: 1 } }"
)


def test_weak_answer_counts_only_on_request(tmp_path: Path) -> None:
    (tmp_path / "rarms.yaml").write_text(LIGHT, encoding="utf-8")
    log = tmp_path / "measurements" / "onboard" / "a" / "light.jsonl"
    with chdir(tmp_path):
        refused = rarms("measure")
        before = log.exists()
        swept = rarms("measure", "--from", "50%", "--to", "50%")
        wanted = rarms("measure", "--weak-load")
        both = rarms("measure", "--interference", "light", "--interference", "busy-loop")
        planned = rarms("plan")

    assert refused.code != 0
    assert "RARMS326" in refused.err
    assert not before
    assert (swept.code, wanted.code, both.code) == (0, 0, 0), swept.err + wanted.err + both.err
    assert all(recorded.provenance.weak_load for recorded in the_log(log).recorded)
    assert planned.code in (0, 2)
    assert "warning[RARMS325]" in planned.out + planned.err


def test_idle_log_is_taken_with_warning(tmp_path: Path) -> None:
    manifest = MANIFEST.replace("[busy-loop, bursts-100]", "busy-loop").replace("at_most: 6 ms", "at_most: 60 ms")
    (tmp_path / "rarms.yaml").write_text(manifest, encoding="utf-8")
    leave_logs(tmp_path, {"a": 12})
    rewrite_log(tmp_path / "measurements" / "onboard" / "a" / "busy-loop.jsonl", with_weak_load)
    with chdir(tmp_path):
        planned = rarms("plan")

    assert planned.code == 0, planned.err
    assert "warning[RARMS105]" in planned.out + planned.err


def test_log_that_decides_is_measured_again_first(tmp_path: Path) -> None:
    def needs_more(recorded: Recorded) -> Recorded:
        return replace(recorded, setting=replace(recorded.setting, reserve=recorded.setting.reserve + 8))

    def order() -> list[str]:
        hosts = rarms_iac.load(str(tmp_path / "rarms.yaml"))
        groups = by_partition(experiments_of_request(hosts, MeasureRequest()))
        (group,) = begin_with_decisive(groups, totals_at_hand(hosts.manifest)[1])
        return [each.setup.interference for each in group]

    (tmp_path / "rarms.yaml").write_text(MANIFEST, encoding="utf-8")
    unknown = order()
    leave_logs(tmp_path, {"a": 12})
    rewrite_log(tmp_path / "measurements" / "onboard" / "a" / "busy-loop.jsonl", needs_more)

    assert unknown == ["bursts-100", "busy-loop"]
    assert order() == ["busy-loop", "bursts-100"]


def test_idle_busy_loop_is_measured_again(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    make = OutsideWork(name="make", group="/user.slice", cpu_ms=200.0)
    counted = SettingEvidence(elapsed_ms=1000.0, cpu_ms={P1: 100.0, P2: 500.0}, others=(make,))
    monkeypatch.setattr(SimulatedRun, "evidence", lambda _running: counted)
    monkeypatch.setattr("rarms_iac.measuring.setting_run.disturbance", lambda *_: "")
    (tmp_path / "rarms.yaml").write_text(MANIFEST.replace("[busy-loop, bursts-100]", "busy-loop"), encoding="utf-8")
    with chdir(tmp_path):
        refused = rarms("measure")
        wanted = rarms("measure", "--weak-load")
        paper = rarms("measure", "--strategy", "paper")
        swept = rarms("measure", "--from", "60%", "--to", "60%")

    said = " ".join(refused.err.split())
    assert refused.code == 4
    assert "other work, a limit or an affinity kept it from using all processors" in said
    assert "busy-loop left 40 % of 1 LP idle. Of 1 LP, make in /user.slice used 20 %." in said
    assert "rarms measure a --interference busy-loop --again" in said
    assert "a: rejected, because the loads left processors idle" in refused.out
    assert "confidence" not in refused.out
    assert [each.code for each in (wanted, paper, swept)] == [0, 0, 0], paper.err + swept.err
    assert "99 % confidence each." in wanted.out
