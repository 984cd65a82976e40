"""`rarms prove`, from words to exit codes: verdicts with their error, on what is applied and nothing else."""

import json
import re
from collections.abc import Iterator
from contextlib import chdir
from dataclasses import replace
from fractions import Fraction
from pathlib import Path
from typing import Any

import pytest

from rarms_iac.cli.ending import ExitCode
from rarms_iac.measuring.proof import STARTS, AppliedLayout, LayoutProof, ProofConditions, judge_layout
from rarms_iac.measuring.proof import prove as run_proof
from rarms_iac.model.outcomes import TooFewSamples, TooManyFailures
from rarms_iac.model.state import Partition
from rarms_iac.model.system import AtMost
from rarms_iac.providers.measuring import MeasuringHost
from rarms_iac.providers.simulated.provider import SimulatedHostProvider
from rarms_iac.storage.datalog.decisions import Proven, ProvenIndex, read_entries
from rarms_iac.storage.datalog.files import append_to_log, configuration_path
from tests.builders import a_component, a_host
from tests.measured import a_series, noisy
from tests.robots import a_measured, a_robot_of
from tests.unit.cli.running import Ran, rarms

SPEECH_APT = "maximum_response_time: { at_most: 200 ms }, throughput: { at_least: 0.5 /s }"
MANIFEST = a_robot_of(
    a_measured(at_most="70 ms", reserve="40 %", processors=None, simulation="work: 20 ms, varies: 10 %"),
    a_measured(
        "speech", criticality=20, reserve="20 %", processors=None, simulation="work: 30 ms, blocked: 20 ms, varies: 5 %"
    ).replace("mean_response_time: { at_most: 50 ms }", SPEECH_APT),
    hosts="onboard: { logical_processors: 2, memory: 4 GiB, keep_for_host: { processor: 10 % } }",
)


@pytest.fixture
def here(tmp_path: Path) -> Iterator[Path]:
    """A folder with a robot of two components, applied, which is where we are."""
    write(tmp_path, MANIFEST)
    with chdir(tmp_path):
        assert rarms("apply", "--auto-approve").code == 0
        yield tmp_path


@pytest.fixture(scope="module")
def long_mean(tmp_path_factory: pytest.TempPathFactory) -> float:
    """The mean response time of vision beside the load, of many samples, in ms."""
    folder = tmp_path_factory.mktemp("long")
    write(folder, MANIFEST)
    with chdir(folder):
        assert rarms("apply", "--auto-approve").code == 0
        return float(str(proven("--samples", "2500")[1]["vision mean_response_time"]["value"]))


def write(folder: Path, text: str) -> None:
    (folder / "rarms.yaml").write_text(text, encoding="utf-8", newline="\n")


def change(folder: Path, old: str, new: str) -> None:
    text = (folder / "rarms.yaml").read_text(encoding="utf-8")
    assert text.count(old) == 1
    write(folder, text.replace(old, new))


def proven(*words: str) -> tuple[int, dict[str, dict[str, object]], list[str]]:
    """Exit code, indexes by name, and the codes of what was found; beside the loads of the policy unless it is said."""
    ran = prove(*words, "--json")
    answer = json.loads(ran.out)
    assert answer["met"] is (ran.code == 0)
    return (
        ran.code,
        {
            f"{each['measured']['component']} {each['measured']['index']}": {
                **each["measured"],
                **(each["measured"]["estimate"] or {}),
                "verdict": each["verdict"],
                "verdict_error": each["error"],
                "samples_needed": each.get("samples_needed"),
            }
            for proof in answer["proofs"]
            for each in proof["verdicts"]
        },
        [finding["code"] for finding in answer["findings"]],
    )


def prove(*words: str) -> Ran:
    return rarms("prove", *([] if "--without-load" in words else ["--load-host"]), *words)


def code_of(ran: Ran) -> tuple[int, str]:
    return ran.code, ran.err[ran.err.index("RARMS") :][:8]


def row_of(text: str, component: str) -> list[str]:
    """The first line of a component's row, cell by cell."""
    return re.split(r"\s{2,}", next(line for line in text.splitlines() if line.startswith(component)))


def test_every_verdict_says_its_error(here: Path) -> None:
    code, indexes, found = proven()
    text = prove().out

    mean = indexes["vision mean_response_time"]
    assert (code, found) == (0, [])
    assert (mean["verdict"], mean["verdict_error"]) == ("met", 0.01)
    assert float(str(mean["lower"])) < float(str(mean["value"])) < float(str(mean["upper"])) < 70
    assert indexes["speech throughput"]["verdict_error"] == 0.01, "one error for all that is said together"
    shown = f"{float(str(mean['value'])):.1f} ms"
    assert row_of(text, "vision")[1:] == ["mean <= 70 ms", shown, "busy-loop", "met"]
    assert re.search(r"\d+ starts, all thresholds met\. Next: `rarms drift`$", " ".join(text.split()))
    assert "99 % confidence each; a maximum or minimum is met" in " ".join(text.split())
    assert "met so far\n" in text, "of a maximum no sample can say what the next job does"
    entry = read_entries(configuration_path(here, "onboard", "vision"))[-1]
    assert isinstance(entry, Proven)
    (recorded,) = entry.indexes
    assert (recorded.verdict, recorded.error, recorded.met) == ("met", 0.01, True)
    assert (recorded.lower, recorded.upper) == (mean["lower"], mean["upper"])


def test_value_near_threshold_says_needed_samples(here: Path, long_mean: float) -> None:
    change(here, "interference: busy-loop", "interference: busy-loop, measuring: { proof: 1 min }")
    change(here, "at_most: 70 ms", f"at_most: {long_mean * 1.008:.3f} ms")
    code, indexes, found = proven()
    ran = prove()
    text, said = ran.out, " ".join(ran.err.split())

    assert (code, found) == (4, ["RARMS111"])
    mean = indexes["vision mean_response_time"]
    assert (mean["verdict"], mean["verdict_error"]) == ("inconclusive", None)
    assert isinstance(mean["samples_needed"], int)
    assert mean["samples_needed"] > 200
    assert f"inconclusive: about {mean['samples_needed']} samples needed" in " ".join(text.split())
    assert "1 inconclusive" in text
    assert f"Take about {mean['samples_needed']} samples of each component, in about " in said
    assert f"rarms prove --samples {mean['samples_needed']} --load-host" in said
    entry = read_entries(configuration_path(here, "onboard", "vision"))[-1]
    assert isinstance(entry, Proven)
    assert (entry.indexes[0].met, entry.indexes[0].samples_needed) == (False, mean["samples_needed"])


def test_proof_goes_on_until_its_thresholds_are_shown(here: Path, long_mean: float) -> None:
    """Its budget of the host's time is longer than eight starts, and its threshold near."""
    change(here, "at_most: 70 ms", f"at_most: {long_mean * 1.02:.3f} ms")
    ran = prove("--json")
    (proof,) = json.loads(ran.out)["proofs"]

    assert ran.code == 0, ran.err
    assert proof["starts"] > STARTS
    assert proof["interference"] == "busy-loop"


def test_proof_keeps_its_budget_unless_asked(here: Path) -> None:
    """80 jobs that are due every 4 s take five minutes, and eight starts of 6 s have a few."""
    change(here, "interference: busy-loop", "interference: busy-loop, measuring: { proof: 1 min }")
    change(here, "mean_response_time: { at_most: 70 ms }", "p90_response_time: { at_most: 90 ms }")
    change(here, "[vision], until: { samples: 60 }", "[vision], arrival: { every: 4 s }")
    change(here, "[speech], until: { samples: 60 }", "[speech]")
    code, indexes, _found = proven()
    _, asked, _found = proven("--samples", "40")

    tail = indexes["vision p90_response_time"]
    assert (code, tail["verdict"], tail["samples_needed"]) == (4, "inconclusive", 80)
    assert int(str(tail["samples"])) < 40
    assert int(str(asked["vision p90_response_time"]["samples"])) >= 40


def test_passed_bound_is_said_while_it_runs(here: Path) -> None:
    """`--samples` outlasts the budget of jobs without a period, whose time is not known when the bound is printed."""
    change(here, "interference: busy-loop", "interference: busy-loop, measuring: { proof: 1 min }")

    short, asked = prove(), prove("--samples", "1500")

    assert "takes longer than" not in short.err
    assert asked.err.count("The proof on onboard takes longer than the announced") == 1, asked.err


def test_load_leaves_unused_time_to_the_next(here: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    change(here, "interference: busy-loop", "interference: [busy-loop, bursts-20], measuring: { proof: 10 min }")
    budgets: list[float] = []

    def with_budget(
        host: MeasuringHost, layout: AppliedLayout, conditions: ProofConditions, *rest: Any
    ) -> LayoutProof | TooManyFailures | None:
        budgets.append(conditions.budget_ms)
        return run_proof(host, layout, conditions, *rest)

    monkeypatch.setattr("rarms_iac.measuring.prove.prove", with_budget)

    assert prove().code == 0
    assert budgets[0] == 300_000
    assert 500_000 < budgets[1] < 600_000


def test_each_load_of_policy_is_proven_and_recorded(here: Path) -> None:
    several = prove("--interference", "busy-loop", "--interference", "bursts-20", "--json")
    weaker = prove("--without-load", "--json")
    entries = read_entries(configuration_path(here, "onboard", "vision"))

    assert (several.code, weaker.code) == (0, 0), several.err
    assert [proof["interference"] for proof in json.loads(several.out)["proofs"]] == ["busy-loop", "bursts-20"]
    assert [proof["interference"] for proof in json.loads(weaker.out)["proofs"]] == [None]
    assert [entry.interference for entry in entries if isinstance(entry, Proven)] == ["busy-loop", "bursts-20", None]
    announced = " ".join(several.err.split())
    begins = "Proof on onboard (simulated) with busy-loop and bursts-20, using all idle time: at least 16 starts"
    assert re.search(re.escape(f"{begins} of all components, ") + r"[^.]*of host time\.", announced), announced
    lines = re.findall(r"^\[(\d/\d)\] onboard  ([\w-]+)  \w+ \w+ [\d.]+ .* (\w+)$", several.err, re.MULTILINE)
    assert lines == [("1/2", "busy-loop", "met"), ("2/2", "bursts-20", "met")], several.err
    again = " ".join(prove("--interference", "busy-loop").err.split())
    assert re.search(r": at least 8 starts of all components, about [0-9.]+ m?s\.", again), again


def test_a_weaker_proof_takes_no_miss_back(here: Path) -> None:
    change(here, "at_most: 70 ms", "at_most: 30 ms")  # 20 ms alone, 50 ms beside a load
    loaded, alone = prove(), prove("--without-load")
    text = " ".join(rarms("status").out.split())

    assert (loaded.code, alone.code) == (4, 0), loaded.err
    assert "of 3 thresholds met with all components running under busy-loop" in text
    assert "vision, mean_response_time at most 30 ms: missed" in text
    assert "3 of 3 thresholds met with all components running without load" in text
    assert "finds a reservation for the components that missed their threshold" in text
    assert prove().code == 4
    assert "without load" not in rarms("status").out, "what was proven beside a load since is more"


def test_a_miss_names_its_ways_out_with_figures(here: Path) -> None:
    change(here, "at_most: 70 ms", "at_most: 20.5 ms")  # 20 ms of work with 0.4 of two processors
    (finding,) = [
        each for each in json.loads(prove("--json").out)["findings"] if each["values"]["component"] == "vision"
    ]
    values, advice = finding["values"], finding["advice"]

    assert finding["code"] == "RARMS118"
    assert values["interference"] == "busy-loop"
    assert values["asked_lp"] > 1.5
    assert values["free_lp"] == pytest.approx(0.6)
    assert values["threshold_that_holds"] > 40
    assert f"needs about {values['asked_lp']} LP, but its partition has 0.8 LP" in advice
    assert "The host has only 0.6 LP free." in advice
    assert f"A threshold of at most {values['threshold_that_holds']} ms was met." in advice


@pytest.mark.parametrize("words", [("prove",), ("apply", "--auto-approve", "--prove")])
def test_idle_time_is_loaded_only_on_request(here: Path, words: tuple[str, ...]) -> None:
    before = (here / ".rarms" / "hosts" / "onboard.json").read_bytes()
    change(here, "reserve: 40 %", "reserve: 45 %")
    ran = rarms(*words)

    assert ran.code == 64, ran.err
    assert "Allow full load with --load-host" in " ".join(ran.err.split())
    assert (here / ".rarms" / "hosts" / "onboard.json").read_bytes() == before, "nothing is applied either"


def test_overloaded_component_misses_before_late_jobs(here: Path) -> None:
    """Jobs come quicker than they are served: each waits longer than the one before."""
    change(here, "at_most: 70 ms", "at_most: 100 s")
    change(here, "command: [vision], until: { samples: 60 }", "command: [vision], arrival: { every: 15 ms }")
    code, indexes, found = proven()

    assert (code, found) == (4, ["RARMS118"])
    mean = indexes["vision mean_response_time"]
    assert (mean["verdict"], mean["estimate"], mean["verdict_error"]) == ("missed", None, 0.01)
    assert isinstance(mean["overload"], dict)
    assert mean["overload"]["period_ms"] == 15
    needed = float(mean["overload"]["needed_lp"])
    assert 1.2 < needed < 1.4
    entry = read_entries(configuration_path(here, "onboard", "vision"))[-1]
    assert isinstance(entry, Proven)
    assert [(index.met, index.verdict, index.value) for index in entry.indexes] == [(False, "missed", None)]
    text = prove().out
    assert int(re.search(r"(\d+) starts?,", " ".join(text.split())).group(1)) < STARTS  # type: ignore[union-attr]  # it is told
    said = re.search(r"missed, overloaded: needs ([0-9.]+) LP", " ".join(text.split()))
    assert said is not None, text
    assert float(said[1]) == pytest.approx(needed, abs=0.01)

    change(here, "work: 20 ms, varies: 10 %", "work: 1 ms, blocked: 20 ms")
    text = " ".join(prove().out.split())
    assert "missed, overloaded: jobs arrive every 15 ms but end every 2" in text, "it waits: LPs say nothing"


def test_dependent_samples_ask_for_twice_as_many() -> None:
    component = a_component("vision", apt={"mean_response_time": AtMost(value=Fraction(99))})
    layout = AppliedLayout(
        application="robot", host_processors=2, reserved=Fraction(1), partitions={}, on_host=(component,)
    )
    series = a_series(noisy(1, 100.0, correlation=0.95, count=64), component="vision")
    (verdict,) = judge_layout(layout, {"vision": series}, statements=None, slow_job=20)

    assert isinstance(verdict.verdict, TooFewSamples)
    assert "samples are correlated" in verdict.measured.reason
    assert verdict.samples_needed == 128


def test_missed_threshold_is_told_with_error(here: Path) -> None:
    change(here, "at_most: 70 ms", "at_most: 15 ms")
    code, indexes, found = proven()

    assert (code, found) == (4, ["RARMS118"])
    mean = indexes["vision mean_response_time"]
    assert mean["verdict"] == "missed"
    shown = f"{float(str(mean['value'])):.1f} ms"
    assert row_of(prove().out, "vision")[1:] == ["mean <= 15 ms", shown, "busy-loop", "missed"]


@pytest.mark.parametrize(
    ("old", "new", "waits"),
    [
        ("reserve: 40 %", "reserve: 55 %", "partition/vision on onboard"),
        (
            "components:\n  vision:",
            "partitions:\n  vision: { components: [vision, speech] }\n\ncomponents:\n  vision:",
            "partition/vision on onboard",
        ),
    ],
    ids=["another reservation", "another layout"],
)
def test_what_is_proven_is_what_is_applied(here: Path, old: str, new: str, waits: str) -> None:
    write(here, (here / "rarms.yaml").read_text(encoding="utf-8").replace(old, new))
    before = (here / ".rarms" / "hosts" / "onboard.json").read_bytes()
    ran = prove()

    assert code_of(ran) == (3, "RARMS119")
    assert waits in " ".join(ran.err.split())
    assert "`rarms apply`" in ran.err
    assert (here / ".rarms" / "hosts" / "onboard.json").read_bytes() == before
    assert rarms("apply", "--auto-approve", "--max-disruption", "removal").code == 0
    assert prove().code == 0


def test_plan_is_proven_as_its_manifest(here: Path, tmp_path: Path) -> None:
    change(here, "reserve: 40 %", "reserve: 45 %")
    elsewhere = tmp_path / "elsewhere"
    elsewhere.mkdir()
    with chdir(elsewhere):
        assert rarms("plan", "-f", str(here / "rarms.yaml"), "--out", "plan.json").code == 0
        done = rarms("apply", "plan.json", "--prove", "--load-host")

    assert done.code == 0, done.err
    assert "Proven on onboard: 2 components together on 1.3 LP of 2 LP under busy-loop" in done.out
    entry = read_entries(configuration_path(here, "onboard", "vision"))[-1]
    assert isinstance(entry, Proven)
    assert entry.reserve == 45


def test_outgrown_plan_is_not_proven(here: Path) -> None:
    change(here, "reserve: 40 %", "reserve: 45 %")
    assert rarms("plan", "--out", "plan.json").code == 0
    change(here, "reserve: 45 %", "reserve: 50 %")
    done = rarms("apply", "plan.json", "--prove", "--load-host")

    assert (done.code, "error[RARMS119]" in done.err) == (3, True)
    assert [machine.settings.reserve for machine in machines(here) if machine.settings.name == "vision"] == [45]


def machines(folder: Path) -> tuple[Partition, ...]:
    host = SimulatedHostProvider(a_host(), folder / ".rarms" / "hosts" / "onboard.json")
    return host.observe().partitions


def test_missing_load_memory_allows_proof_without_load(here: Path) -> None:
    change(here, "memory: 4 GiB", "memory: 1 GiB")
    ran = prove()

    assert code_of(ran) == (4, "RARMS115")
    assert "onboard does not have enough memory for the partition of busy-loop." in " ".join(ran.err.split())
    assert "`rarms prove --without-load`" in ran.err
    assert rarms("prove", "--without-load").code == 0


def test_component_of_host_itself_runs_among_others(here: Path) -> None:
    change(here, "    criticality: 20\n", "    criticality: 20\n    runs_on: host\n")
    change(here, "    cpu: { reserve: 20 % }\n", "")
    assert rarms("apply", "--auto-approve").code == 0
    code, indexes, _ = proven("--without-load")
    entry = read_entries(configuration_path(here, "onboard", "speech"))[-1]

    assert code == 0
    assert indexes["speech throughput"]["verdict"] == "met"
    assert isinstance(entry, Proven)
    assert (entry.partition, entry.reserve, entry.beside) == ("", 0, ("vision",))


def test_unasked_hosts_are_named_and_not_missed(here: Path) -> None:
    change(
        here,
        "processor: 10 % } }\n",
        "processor: 10 % } }\n  second: { logical_processors: 2, memory: 4 GiB }\n",
    )
    change(here, "    criticality: 20\n", "    criticality: 20\n    hosts: [second]\n")
    assert rarms("apply", "--auto-approve", "--max-disruption", "removal").code == 0
    both, onboard = prove(), prove("--host", "onboard")

    assert (both.code, onboard.code) == (0, 0), onboard.err
    assert "speech" in both.out
    assert "speech" not in onboard.out
    assert "on other hosts: speech" in onboard.err


def test_without_threshold_nothing_is_said_to_be_met(here: Path) -> None:
    change(here, "    apt: { mean_response_time: { at_most: 70 ms } }\n", "")
    change(here, f"    apt: {{ {SPEECH_APT} }}\n", "")
    assert rarms("apply", "--auto-approve").code in (0, 2)
    ran = prove()

    assert ran.code == 0, ran.err
    assert "nothing is proven" in ran.out
    assert "met" not in ran.out


PHASES = """\
schema: rarms/v1
application: { name: phases }
policy: { interference: busy-loop }
hosts:
  onboard: { logical_processors: 1, memory: 4 GiB }
components:
  short:
    criticality: 2
    memory: 512 MiB
    apt: { mean_response_time: { at_most: 5.6 ms } }
    run: { command: [short], arrival: { every: 50 ms } }
    cpu: { reserve: 11 % }
    simulation: { work: 5 ms, varies: 1 % }
  long:
    criticality: 1
    memory: 512 MiB
    run: { command: [long], arrival: { every: 300 ms } }
    cpu: { reserve: 51 % }
    simulation: { work: 100 ms, varies: 1 % }
"""


def test_differing_starts_are_more_not_longer(tmp_path: Path) -> None:
    """Each start keeps the phase in which the two began, and only few of them are bad for the short one."""
    write(tmp_path, PHASES)
    with chdir(tmp_path):
        assert rarms("apply", "--auto-approve").code == 0
        (proof,) = json.loads(prove("--json").out)["proofs"]
    (verdict,) = proof["verdicts"]
    estimate = verdict["measured"]["estimate"]

    assert verdict["verdict"] == "missed", "its mean is 5.1 ms in most phases, and up to 15 in some"
    assert proof["starts"] > 100
    assert estimate["samples"] / proof["starts"] < 10, "starts of an eighth of all would become longer and longer"


def test_unrunnable_component_is_named_with_line(here: Path) -> None:
    write(here, MANIFEST.replace("    simulation: { work: 20 ms, varies: 10 % }\n", ""))

    ran = rarms("prove", "--load-host")

    assert ran.code == 4
    assert "RARMS114" in ran.err
    assert "components.vision" in ran.err


def test_stopped_proof_keeps_ended_loads(here: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    change(here, "interference: busy-loop", "interference: [busy-loop, bursts-20]")

    def stopped_at_second(
        host: MeasuringHost, layout: AppliedLayout, conditions: ProofConditions, *rest: Any
    ) -> LayoutProof | TooManyFailures | None:
        return None if conditions.interference == "bursts-20" else run_proof(host, layout, conditions, *rest)

    monkeypatch.setattr("rarms_iac.measuring.prove.prove", stopped_at_second)

    ran = prove()

    entries = read_entries(configuration_path(here, "onboard", "vision"))
    assert [entry.interference for entry in entries if isinstance(entry, Proven)] == ["busy-loop"]
    assert ran.code == ExitCode.INTERRUPTED
    assert "The proofs with busy-loop are saved." in " ".join(ran.err.split())
    assert "`rarms prove --interference bursts-20 --load-host`" in " ".join(ran.err.split())
    assert "busy-loop" in ran.out


def test_stopped_proof_without_load_starts_again_so(here: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("rarms_iac.measuring.prove.prove", lambda *_: None)

    ran = rarms("prove", "--without-load", "--samples", "40")

    assert ran.code == ExitCode.INTERRUPTED
    assert "Start again: `rarms prove --without-load --samples 40`." in " ".join(ran.err.split())


def test_value_too_near_its_threshold_is_not_measured_again(here: Path) -> None:
    """More samples do not help, and another search is not what its finding advises."""
    near = ProvenIndex(
        index="mean_response_time",
        threshold=AtMost(value=Fraction(70)),
        value=69.9,
        lower=69.0,
        upper=70.8,
        met=False,
        verdict="inconclusive",
    )
    assert prove().code == 0
    log = configuration_path(here, "onboard", "vision")
    proven_last = read_entries(log)[-1]
    assert isinstance(proven_last, Proven)
    append_to_log(log, replace(proven_last, indexes=(near,)))

    assert "Next: `rarms explain vision` shows a value too close to its threshold" in rarms("status").out
