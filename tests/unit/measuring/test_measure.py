"""`rarms measure` and `rarms prove`, from words to exit codes, on the simulated host."""

import json
from collections.abc import Iterator, Sequence
from contextlib import chdir
from pathlib import Path

import pytest

from rarms_iac.app.control import UNATTENDED, Control
from rarms_iac.app.hosts import Hosts, load
from rarms_iac.measuring import measure
from rarms_iac.measuring.measure_request import ExperimentResult, MeasureRequest
from rarms_iac.model.experiment import Experiment
from rarms_iac.model.outcomes import Stopped
from rarms_iac.providers.simulated.provider import SimulatedHostProvider
from rarms_iac.storage.datalog.decisions import Chosen, Proven, read_entries
from rarms_iac.storage.datalog.files import configuration_path
from rarms_iac.storage.writing import hold
from tests.builders import a_host, at_most
from tests.measuring import the_log
from tests.robots import a_measured, a_robot_of
from tests.unit.cli.running import Ran, rarms

MANIFEST = a_robot_of(a_measured()) + "\ninterference:\n  light: { kind: busy_loop, threads: 1 }\n"


@pytest.fixture
def here(tmp_path: Path) -> Iterator[Path]:
    """A folder with a robot of one component, which is where we are."""
    write(tmp_path, MANIFEST)
    with chdir(tmp_path):
        yield tmp_path


def write(folder: Path, text: str) -> None:
    (folder / "rarms.yaml").write_text(text, encoding="utf-8", newline="\n")


def measured(*words: str) -> dict[str, object]:
    ran = rarms("measure", *words, "--json")
    assert ran.code == 0, ran.err
    (only,) = json.loads(ran.out)["experiments"]
    assert isinstance(only, dict)
    return only


def reserves(experiment: dict[str, object]) -> list[int]:
    settings = experiment["measured"]
    assert isinstance(settings, list)
    return [setting["reserve"] for setting in settings]


def host(folder: Path) -> SimulatedHostProvider:
    return SimulatedHostProvider(a_host(), folder / ".rarms" / "hosts" / "onboard.json")


def test_stop_on_one_robot_leaves_the_rest(here: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    vision = MANIFEST.partition("  vision:")[2].partition("\ninterference:")[0]
    more = f"  speech:{vision}  hearing:{vision}\npartitions:\n  talk: {{ components: [hearing, speech] }}\n"
    spare = "  spare: { logical_processors: 2, memory: 4 GiB }\n"
    text = MANIFEST.replace("components:", f"{spare}components:")
    write(here, text.replace("\ninterference:", f"{more}\ninterference:"))

    def stopped_there(
        hosts: Hosts, _request: MeasureRequest, _control: Control, experiments: Sequence[Experiment]
    ) -> measure.MeasureOutcome:
        asked.append(hosts.chosen)
        result = ExperimentResult(
            experiment=experiments[0], conclusion=Stopped(), settings=(), run_now=frozenset(), planned=None, log=""
        )
        return measure.MeasureOutcome(experiments=(result,), findings=())

    asked: list[Sequence[str]] = []
    monkeypatch.setattr(Hosts, "robot", lambda _hosts, _name: object())
    monkeypatch.setattr(measure, "_measure_there", stopped_there)

    outcome = measure.measure_components(load(here), control=UNATTENDED)

    left = [(each.host.name, each.setup.members) for each in outcome.not_begun]
    assert [list(chosen) for chosen in asked] == [["onboard"]]
    assert left == [
        ("onboard", ("hearing", "speech")),
        ("spare", ("vision",)),
        ("spare", ("hearing", "speech")),
    ]


def test_from_nothing_to_a_proven_layout(here: Path) -> None:
    first = rarms("measure")
    second = rarms("measure")
    applied = rarms("apply", "--auto-approve", "--prove", "--load-host")

    assert (first.code, second.code) == (0, 0), first.err
    assert "by an earlier run" not in first.out
    assert ", all of them by an earlier run." in second.out
    assert (here / "measurements" / "onboard" / "vision" / "busy-loop.jsonl").is_file()
    assert applied.code == 0, applied.err
    assert "Proven on onboard: 1 component on " in applied.out
    assert "all thresholds met" in applied.out
    chosen, proven = read_entries(configuration_path(here, "onboard", "vision"))
    assert isinstance(chosen, Chosen)
    assert isinstance(proven, Proven)
    assert proven.reserve == chosen.reserve
    assert [(index.index, index.threshold, index.met) for index in proven.indexes] == [
        ("mean_response_time", at_most(50), True)
    ]


def test_what_the_manifest_fixes_counts_in_the_total(here: Path) -> None:
    path = here / "rarms.yaml"
    more = "  speech: { criticality: 1, memory: 256 MiB, cpu: { reserve: 0.5 LP }, simulation: { work: 1 ms } }\n"
    path.write_text(path.read_text(encoding="utf-8").replace("components:\n", "components:\n" + more), "utf-8")

    ran = rarms("measure", "vision", "--from", "50%", "--to", "50%", "--samples", "60", "-v")

    assert ran.code == 0, ran.err
    assert "1.5 LP of 2 LP reserved, 0.5 LP free, 0.5 LP of it fixed in the manifest." in ran.out


def test_most_critical_component_is_measured_and_told_first(here: Path) -> None:
    audio = """\
  audio:
    criticality: 20
    apt: { mean_response_time: { at_most: 50 ms } }
    run: { command: [audio], until: { samples: 60 }, samples: { from: per_run } }
    memory: 512 MiB
    simulation: { work: 20 ms, varies: 2 % }
  base:
    criticality: 40
    apt: { mean_response_time: { at_most: 50 ms } }
    run: { command: [base], until: { samples: 60 }, samples: { from: per_run } }
    memory: 512 MiB
    simulation: { work: 20 ms, varies: 2 % }

interference:"""
    write(here, MANIFEST.replace("\ninterference:", audio))

    ran = rarms("measure", "--from", "50%", "--to", "50%")

    summary = ran.out[ran.out.index("component ") :]
    assert [line.split()[0] for line in summary.splitlines()[1:4]] == ["base", "vision", "audio"]


def test_papers_walk_says_its_message(here: Path) -> None:
    write(here, MANIFEST.replace("at_most: 50 ms", "at_most: 15 ms"))
    ran = rarms("measure", "--strategy", "paper")

    assert ran.code == 4
    assert "Threshold performance is not achievable on this platform." in ran.err
    assert "vision at 100 % of its VPs: mean_response_time" in ran.err
    assert "not achievable" in ran.out
    assert "onboard: vision is not achieved." in " ".join(ran.out.split())
    assert "Next:" not in ran.out


def test_the_papers_walk_wants_the_host_to_itself(here: Path) -> None:
    write(here, MANIFEST.replace("memory: 4 GiB }", "memory: 4 GiB, keep_for_host: { processor: 10 % } }"))

    assert refused(rarms("measure", "--strategy", "paper")) == (3, "RARMS115")
    assert max(reserves(measured("--from", "50%", "--to", "90%", "--step", "40%"))) == 90
    above = rarms("measure", "--from", "50%")
    assert refused(above) == (4, "RARMS115")
    assert "Limit the measurement: `--to 90%`." in above.err
    assert refused(rarms("measure", "--from", "50%", "--to", "100%", "--step", "50%")) == (4, "RARMS115")


def refused(ran: Ran) -> tuple[int, str]:
    return ran.code, ran.err[ran.err.index("RARMS") :][:8]


def test_other_load_has_its_own_log(here: Path) -> None:
    swept = measured("vision", "--from", "20%", "--to", "50%", "--step", "15 %", "--interference", "light")

    assert swept["ending"] == "swept"
    assert reserves(swept) == [20, 35, 50]
    assert swept["log"] == "measurements/onboard/vision/light.jsonl"


def test_seed_places_chance_and_changes_no_count(here: Path) -> None:
    words = ("--from", "40%", "--to", "50%")
    measured(*words)
    other = measured(*words, "--seed", "2")
    longer = measured("--from", "40%", "--to", "60%", "--seed", "2")

    assert (other["new"], longer["new"]) == (0, 1)
    log = the_log(here / "measurements" / "onboard" / "vision" / "busy-loop.jsonl")
    assert [each.setting.seed for each in log.recorded] == [1, 1, 2]


def test_a_changed_component_is_measured_again(here: Path) -> None:
    measured("--from", "50%", "--to", "60%")
    write(here, MANIFEST.replace("work: 20 ms", "work: 22 ms"))
    ran = rarms("measure", "--from", "50%", "--to", "50%")

    assert ran.code == 0
    assert "Changed since measurements" in ran.err
    assert "vision.simulation.work: 20 ms -> 22 ms." in " ".join(ran.err.split())
    assert reserves(measured("--from", "50%", "--to", "50%")) == [50]

    write(here, MANIFEST)
    again = measured("--from", "50%", "--to", "60%")
    assert again["new"] == 0, "the earlier results stay in the file"


def test_other_hardware_is_refused_before_platform_is_named(here: Path) -> None:
    measured("--from", "50%", "--to", "50%")
    other = here / "robot-2.yaml"
    other.write_text("hosts: { onboard: { logical_processors: 4 } }\n", encoding="utf-8")
    words = ("measure", "--from", "50%", "--to", "50%", "--overlay", str(other))

    refusal = rarms(*words)
    assert refused(refusal) == (4, "RARMS102")
    assert "logical processors: 2 -> 4" in " ".join(refusal.err.split())
    assert "`platform: NAME`" in refusal.err
    assert rarms(*words, "--again").code == 0, "the same machine was changed"

    assert measured("--from", "50%", "--to", "50%")["new"] == 0
    other.write_text("hosts: { onboard: { logical_processors: 8, platform: large } }\n", encoding="utf-8")
    assert rarms(*words).code == 0


def test_running_partitions_block_unless_borne(here: Path) -> None:
    words = ("--from", "30%", "--to", "30%")
    measured(*words)
    assert rarms("apply", "--auto-approve").code == 4, "30 % is not enough"
    write(here, MANIFEST.replace("reserve: measured", "reserve: 50 %"))
    assert rarms("apply", "--auto-approve").code == 0
    ran = rarms("measure", "--from", "40%", "--to", "40%")

    assert refused(ran) == (3, "RARMS115")
    assert "vision" in ran.err
    assert rarms("measure", *words).code == 0, "what is recorded needs no host"
    borne = rarms("measure", "--from", "40%", "--to", "40%", "--on-busy-host")
    assert borne.code == 0, borne.err
    assert "RARMS105" in borne.err
    log = here / "measurements" / "onboard" / "vision" / "busy-loop.jsonl"
    assert the_log(log).recorded[-1].provenance.beside == ("vision",)


def test_a_held_host_is_measured_by_one_only(here: Path) -> None:
    measured("--from", "50%", "--to", "50%")
    with hold(here / ".rarms" / "hosts" / "onboard.lock", "somebody else"):
        ran = rarms("measure", "--from", "60%", "--to", "60%")

    assert ran.code == 3
    assert "somebody else" in ran.err


def test_unmeasurable_component_is_told_with_line(here: Path) -> None:
    write(here, MANIFEST.replace("    simulation: { work: 20 ms, varies: 2 % }\n", ""))
    assert refused(rarms("measure")) == (4, "RARMS114")

    write(
        here,
        MANIFEST.replace("    apt: { mean_response_time: { at_most: 50 ms } }\n", "").replace("measured", "5 %"),
    )
    assert refused(rarms("measure", "vision")) == (4, "RARMS016")
    everything = rarms("measure")
    assert refused(everything) == (4, "RARMS016")
    assert "No component has an `apt`" in everything.err
    assert everything.out == "", "no table without a row"


def test_a_damaged_log_is_not_replaced(here: Path) -> None:
    measured("--from", "50%", "--to", "60%")
    log = here / "measurements" / "onboard" / "vision" / "busy-loop.jsonl"
    log.write_bytes(log.read_bytes().replace(b'"reserve":50', b'"reserve":51'))
    before = log.read_bytes()

    assert refused(rarms("measure")) == (4, "RARMS107")
    assert log.read_bytes() == before


@pytest.mark.parametrize(
    "words",
    [
        ("--from", "0%"),
        ("--from", "50"),
        ("--from", "50%", "--to", "40%"),
        ("--together", "vision"),
        ("nobody",),
        ("--interference", "nothing"),
        ("--interactive",),
    ],
)
def test_words_that_make_no_sense_are_wrong_usage(here: Path, words: tuple[str, ...]) -> None:
    assert rarms("measure", *words).code == 64


def test_picked_level_stands_in_summary(here: Path) -> None:
    ran = rarms("measure", "--interactive", stdin="90 ms\ny\n", at_a_terminal=True)
    summary = rarms("measure", "--from", "45%", "--to", "45%").out

    assert ran.code == 0, ran.err
    assert "A level for vision" in ran.err
    assert "at_most: 90 ms" in (here / "rarms.yaml").read_text(encoding="utf-8")
    for told in (ran.out, summary, rarms("report", "--text").out, rarms("explain", "vision").out):
        assert "90 ms" in told
        assert "50 ms" not in told
    assert "enough" not in ran.out, "the search was for another level"
    assert "vision: a plan" in ran.out, "what a plan reserves stands beside it"


def test_unmet_threshold_is_told_unless_changed(here: Path) -> None:
    write(here, MANIFEST.replace("at_most: 50 ms", "at_most: 15 ms"))
    search = ("measure", "--interactive", "--strategy", "bisection")
    picked = rarms(*search, stdin="40 ms\ny\n", at_a_terminal=True)
    assert (picked.code, "RARMS110" in picked.err) == (0, False), picked.err
    write(here, MANIFEST.replace("at_most: 50 ms", "at_most: 15 ms"))
    left = rarms(*search, stdin="\n", at_a_terminal=True)
    assert (left.code, "RARMS110" in left.err) == (4, True)


def test_several_components_are_measured_together_in_one_partition(here: Path) -> None:
    two = MANIFEST.replace(
        "  vision:",
        "  speech:\n    criticality: 10\n    memory: 256 MiB\n    cpu: { reserve: 5 % }\n"
        "    apt: { mean_response_time: { at_most: 300 ms } }\n    simulation: { work: 10 ms, varies: 2 % }\n  vision:",
    )
    write(here, two)
    together = measured("speech", "vision", "--together", "--from", "50%", "--to", "60%")

    assert together["components"] == ["speech", "vision"]
    assert together["log"] == "measurements/onboard/speech+vision/busy-loop.jsonl"
    log = the_log(here / "measurements" / "onboard" / "speech+vision" / "busy-loop.jsonl")
    assert log.header.setup.memory == (256 + 512) * 2**20
    components = [[series.component for series in each.setting.series] for each in log.recorded]
    assert components == [["speech", "vision"]] * 2
