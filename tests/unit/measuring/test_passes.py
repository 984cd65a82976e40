"""The passes of `rarms measure`: a provisional answer for every component first, then the loads and the precision."""

import json
import re
from collections.abc import Iterator
from contextlib import chdir
from dataclasses import replace
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import pytest

import rarms_iac
from rarms_iac.app.applying import refuse_provisional
from rarms_iac.app.control import Control, NeverStop
from rarms_iac.app.planning import plan_request
from rarms_iac.app.use_case_errors import Outcome, UseCaseError
from rarms_iac.cli.applying import write_and_advise
from rarms_iac.measuring.each_load import decisive
from rarms_iac.measuring.measure_request import MeasureRequest
from rarms_iac.model.host import ProviderKind
from rarms_iac.model.loads import LOADS_WITHOUT_ENTRY, load_of_first_pass
from rarms_iac.model.operations import StartPartition
from rarms_iac.model.plan import Plan
from rarms_iac.views.console import render
from rarms_iac.views.measure import summary_text
from tests.builders import a_host
from tests.measuring import the_log
from tests.unit.cli.running import rarms

MANIFEST = """\
schema: rarms/v1
application: { name: robot }
hosts:
  onboard: { logical_processors: 2, memory: 4 GiB }
components:
  vision:
    criticality: 20
    apt: { mean_response_time: { at_most: 50 ms } }
    simulation: { work: 20 ms, varies: 5 % }
    processors: 1
  planner:
    criticality: 10
    apt: { p95_response_time: { at_most: 120 ms } }
    run: { command: [plan], arrival: { every: 200 ms } }
    simulation: { work: 20 ms, varies: 10 % }
    processors: 1
policy: { interference: [busy-loop, bursts-20], measuring: { setting: 2 min } }
"""
LOADS = ("bursts-20", "busy-loop")


@pytest.fixture
def here(tmp_path: Path) -> Iterator[Path]:
    (tmp_path / "rarms.yaml").write_text(MANIFEST, encoding="utf-8")
    with chdir(tmp_path):
        yield tmp_path


def test_quick_answer_gives_a_provisional_plan(here: Path) -> None:
    quick = rarms("measure", "--quick")
    again = rarms("measure", "--quick", "--json")
    planned = rarms("plan")
    applied = rarms("apply", "--auto-approve")

    logs = sorted(path.as_posix() for path in Path("measurements").glob("onboard/*/*.jsonl"))
    loads = sorted(f"measurements/onboard/{name}/{load}.jsonl" for name in ("planner", "vision") for load in LOADS)
    assert logs == loads
    assert all(record.setting.first_pass for log in logs for record in the_log(here / log).recorded)
    assert quick.code == 0, quick.err
    assert "All reservations are provisional" in quick.out
    settings = [setting for each in json.loads(again.out)["experiments"] for setting in each["measured"]]
    estimates = [index["estimate"] for setting in settings for index in setting["indexes"] if index["estimate"]]
    assert {(each["lower"], each["upper"]) for each in estimates} == {(None, None)}
    assert all(setting["first_pass"] for setting in settings)
    assert [(each["is_provisional"], each["new"]) for each in json.loads(again.out)["experiments"]] == [(True, 0)] * 4
    assert planned.code == 0
    assert "from rarms.yaml, provisional" in planned.out
    assert planned.out.count("RARMS108") == 1
    assert applied.code == 0, "a simulated host takes it"


def test_least_certain_estimates_are_named(here: Path) -> None:
    extreme = MANIFEST.replace("mean_response_time: { at_most: 50 ms }", "maximum_response_time: { at_most: 0.2 s }")
    (here / "rarms.yaml").write_text(extreme, encoding="utf-8")

    quick = rarms("measure", "--quick")
    planned = rarms("plan", "--out", "robot.plan")
    applied = rarms("apply", "robot.plan")

    named = "Least certain: vision (maximum of few jobs)."
    assert f"~ {named}" in quick.out
    assert re.search(r"^vision +maximum <= 0\.2 s +0\.\d+ s~ ", quick.out, re.MULTILINE)
    assert named in " ".join((planned.out + planned.err).split())
    assert applied.code == 0, "the plan is made again from what it has"


def test_measure_goes_on_from_the_first_pass(here: Path) -> None:
    rarms("measure", "--quick")
    ran = rarms("measure", "--json")
    planned = rarms("plan", "--json")

    ended = [(each["components"], each["interference"]) for each in json.loads(ran.out)["experiments"]]
    assert sorted(ended) == [([name], load) for name in ("planner", "vision") for load in LOADS]
    assert not any(each["is_provisional"] for each in json.loads(ran.out)["experiments"])
    assert "RARMS108" not in {finding["code"] for finding in json.loads(planned.out)["findings"]}


def test_measured_component_is_not_searched_again(here: Path) -> None:
    one = MANIFEST.replace("logical_processors: 2", "logical_processors: 1")
    (here / "rarms.yaml").write_text(one.replace("setting: 2 min", "setting: 1 min"), encoding="utf-8")

    first = json.loads(rarms("measure", "vision", "--json").out)
    again = json.loads(rarms("measure", "vision", "--json").out)

    assert {each["ending"] for each in first["experiments"]} == {"found"}
    assert [each["new"] for each in again["experiments"]] == [0, 0]


class StopsInSecondPass(NeverStop):
    """Asks for an end as soon as a data log has a setting of a later pass."""

    def should_stop(self) -> bool:
        logs = [the_log(path) for path in Path().rglob("bursts-20.jsonl")]
        return any(not record.setting.first_pass for log in logs for record in log.recorded)


@pytest.mark.usefixtures("here")
def test_stop_keeps_the_answers_so_far() -> None:
    hosts = rarms_iac.load("rarms.yaml")
    outcome = rarms_iac.measure(hosts, MeasureRequest(), Control(stop=StopsInSecondPass()))
    planned = rarms_iac.plan(hosts)

    assert outcome.stopped
    answers = {each[0].components: decisive(each) for each in outcome.partitions}
    assert all(each.planned is not None for each in answers.values())
    assert [len(each) for each in outcome.partitions] == [2, 2], "a load that was not begun has its first look"
    shown = render(summary_text(outcome), width=80)
    assert ": stopped" in shown
    assert [row.split()[-4:-1] for row in shown.splitlines() if row.split()[-1:] in (["busy-loop"], ["bursts-20"])]
    assert " - " not in shown
    assert {name for each in outcome.experiments for name in each.components} == {"vision", "planner"}
    assert planned.provisional == ("planner", "vision")


def on_linux(plan: Plan) -> Plan:
    return replace(
        plan, hosts=tuple(replace(part, host=a_host("onboard", provider=ProviderKind.LINUX)) for part in plan.hosts)
    )


@pytest.mark.usefixtures("here")
def test_real_host_needs_consent() -> None:
    hosts = rarms_iac.load("rarms.yaml")
    rarms_iac.measure(hosts, MeasureRequest(quick=True))
    plan = rarms_iac.plan(hosts)
    accepted = rarms_iac.plan(hosts, replace(plan_request(hosts), accept_provisional=True))

    refuse_provisional(plan)
    refuse_provisional(on_linux(accepted))
    with pytest.raises(UseCaseError) as refused:
        refuse_provisional(on_linux(plan))
    assert refused.value.outcome is Outcome.REFUSED
    (finding,) = refused.value.findings
    assert finding.code == "RARMS109"
    assert finding.values["partitions"] == ("planner", "vision")


@pytest.mark.usefixtures("here")
def test_written_provisional_plan_is_not_advised(tmp_path: Path) -> None:
    hosts = rarms_iac.load("rarms.yaml")
    rarms_iac.measure(hosts, MeasureRequest(quick=True))
    plan = on_linux(rarms_iac.plan(hosts))
    told: list[str] = []
    session: Any = SimpleNamespace(terminal=SimpleNamespace(tell=told.append))

    write_and_advise(session, str(tmp_path / "robot.plan"), plan)

    assert "`rarms apply` will refuse it" in told[0]
    assert "Apply it with" not in told[0]


def test_unchanged_provisional_partition_needs_no_consent(here: Path) -> None:
    rarms("measure", "--quick")
    rarms("apply", "--auto-approve")
    fixed = MANIFEST.replace("    criticality: 20", "    criticality: 20\n    cpu: { reserve: 40 % }")
    (here / "rarms.yaml").write_text(fixed, encoding="utf-8")
    hosts = rarms_iac.load("rarms.yaml")

    plan = rarms_iac.plan(hosts)

    assert [part.provisional for part in plan.hosts] == [("planner",)]
    assert {step.address.partition for part in plan.hosts for step in part.steps} == {"vision"}
    refuse_provisional(on_linux(plan))


@pytest.mark.usefixtures("here")
def test_start_alone_needs_no_consent() -> None:
    rarms("measure", "--quick")
    plan = on_linux(rarms_iac.plan(rarms_iac.load("rarms.yaml")))
    starts = [[step for step in part.steps if isinstance(step.operation, StartPartition)] for part in plan.hosts]
    hosts = tuple(replace(part, steps=tuple(own)) for part, own in zip(plan.hosts, starts, strict=True))

    refuse_provisional(replace(plan, hosts=hosts))

    assert [len(own) for own in starts] == [2]


def test_quick_without_answer_is_an_error(here: Path) -> None:
    (here / "rarms.yaml").write_text(MANIFEST.replace("at_most: 50 ms", "at_most: 1 ms"), encoding="utf-8")

    quick = rarms("measure", "vision", "--quick")

    assert quick.code == 4, quick
    assert "error[RARMS11" in quick.err


def test_provisional_plan_stays_without_an_answer(here: Path) -> None:
    short = MANIFEST.replace("mean_response_time: { at_most: 50 ms }", "p99_response_time: { at_most: 60 ms }")
    (here / "rarms.yaml").write_text(short.replace("setting: 2 min", "setting: 1 s"), encoding="utf-8")

    ran = rarms("measure")
    planned = rarms_iac.plan(rarms_iac.load("rarms.yaml"))

    assert planned.provisional == ("planner", "vision")
    first = re.search(r"First pass: vision ([0-9.]+ LP)", ran.err)
    assert first
    assert f"vision: inconclusive; a plan reserves {first[1]}, provisional." in ran.out
    assert "All reservations are provisional" in ran.out


def test_plan_says_conditions_of_first_pass(here: Path) -> None:
    fixed = MANIFEST.replace("    criticality: 10", "    criticality: 10\n    cpu: { reserve: 20 % }")
    (here / "rarms.yaml").write_text(fixed, encoding="utf-8")
    rarms("measure", "vision", "--quick")
    rarms("apply", "--auto-approve")
    for path in here.glob("measurements/onboard/vision/*.jsonl"):
        path.unlink()
    rarms("measure", "vision", "--quick", "--on-busy-host")

    planned = rarms("plan")

    assert "RARMS108" in planned.out
    assert "These partitions ran on the host during the measurement of" in " ".join(planned.out.split())


class StopsAfterOneLook(NeverStop):
    """Asks for an end after one setting with the second load."""

    def should_stop(self) -> bool:
        return any(the_log(path).recorded for path in Path().rglob("busy-loop.jsonl"))


def test_look_that_misses_ends_the_provisional_answer(here: Path) -> None:
    tail = MANIFEST.replace("mean_response_time: { at_most: 50 ms }", "p99_response_time: { at_most: 60 ms }")
    (here / "rarms.yaml").write_text(tail, encoding="utf-8")
    hosts = rarms_iac.load("rarms.yaml")
    request = MeasureRequest(components=("vision",), quick=True)
    outcome = rarms_iac.measure(hosts, request, Control(stop=StopsAfterOneLook()))
    planned = rarms("plan")

    shown = render(summary_text(outcome), width=80)
    assert f"{float(decisive(outcome.experiments).reserved_lp or 0):g} LP  bursts-20" in shown
    assert "vision: stopped during the measurement with busy-loop." in shown
    assert [result.reserve is None for result in outcome.experiments] == [False, True]
    assert outcome.totals["onboard"].reserved_lp == 0
    assert planned.code == 4
    assert "busy-loop.jsonl: no setting of the first pass meets the thresholds." in planned.err


@pytest.mark.usefixtures("here")
def test_provisional_choice_is_not_recorded() -> None:
    rarms("measure", "vision", "--quick")
    before = [*Path("measurements").glob("onboard/*.jsonl")]
    rarms("measure", "vision")

    assert before == []
    assert [path.name for path in Path("measurements").glob("onboard/*.jsonl")] == ["vision.configuration.jsonl"]


@pytest.mark.usefixtures("here")
def test_consent_is_in_the_plan_file() -> None:
    rarms("measure", "--quick")
    ran = rarms("plan", "--accept-provisional", "--out", "robot.plan")
    shown = rarms("show", "robot.plan", "--json")

    assert ran.code == 0, ran.err
    assert ", provisional" in ran.out.splitlines()[0]
    assert "RARMS108" not in ran.out + ran.err
    assert json.loads(shown.out)["accepts_provisional"] is True


@pytest.mark.usefixtures("here")
@pytest.mark.parametrize("options", [["--strategy", "paper"], ["--from", "20%"], ["--again"]])
def test_quick_contradicts_what_has_no_passes(options: list[str]) -> None:
    assert rarms("measure", "--quick", *options).code == 64


def test_load_of_the_first_pass() -> None:
    loads = LOADS_WITHOUT_ENTRY

    def chosen(*names: str) -> str:
        return load_of_first_pass({name: loads[name] for name in names})

    assert chosen("busy-loop", "bursts-20", "bursts-100") == "bursts-20"
    assert chosen("busy-loop", "bursts-50", "bursts-5") == "bursts-50"
    assert chosen("busy-loop", "bursts-20-half") == "bursts-20-half"
    assert chosen("busy-loop") == "busy-loop"
