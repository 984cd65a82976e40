"""Plans with measured reservations, from files to exit codes."""

from collections.abc import Mapping
from dataclasses import replace
from pathlib import Path

import pytest

from rarms_iac.app.data_logs import known_platform, measured_reservations, stale_advice, why_outdated
from rarms_iac.app.manifests import load_manifest
from rarms_iac.app.requests import ManifestSource
from rarms_iac.model.layout import LookedUp
from rarms_iac.model.seen_host import unseen
from rarms_iac.model.setting import MachineSpeed, SettingEvidence
from rarms_iac.model.state import State
from rarms_iac.planner.layout_findings import other_governor
from rarms_iac.storage.datalog.identity import Changed
from tests.builders import a_host
from tests.builders_measured import a_setting
from tests.measuring import leave_log, steady
from tests.unit.cli.running import rarms

MANIFEST = """\
schema: rarms/v1

application:
  name: robot

hosts:
  onboard:
    provider: simulated
    platform: two-core
    logical_processors: 2
    memory: 4 GiB

components:
  vision:
    criticality: 30
    apt: # what people notice
      mean_response_time: { at_most: 100 ms }  # a tenth of a second
    run:
      command: [python3, vision.py]
      until: { samples: 200 }
    memory: 512 MiB
    simulation: { work: 61.6 ms, blocked: 26.4 ms }
"""

MEANS = {10: 700.0, 40: 160.0, 60: 112.0, 61: 105.0, 62: 97.0, 70: 88.0}


def measure(folder: Path, means: Mapping[int, float], *, build: int = 26100) -> Path:
    """What `rarms measure vision` leaves behind: settings with these means."""
    settings = [a_setting(reserve, steady("vision", mean)) for reserve, mean in means.items()]
    return leave_log(folder, ["vision"], settings, build=build)


@pytest.fixture
def here(tmp_path: Path) -> Path:
    """A folder with a robot of one measured component."""
    (tmp_path / "rarms.yaml").write_text(MANIFEST, encoding="utf-8", newline="\n")
    (tmp_path / "vision.py").write_text("print()\n", encoding="utf-8", newline="\n")
    return tmp_path


def edit(file: Path, before: str, after: str) -> None:
    text = file.read_text(encoding="utf-8")
    assert before in text
    file.write_text(text.replace(before, after), encoding="utf-8", newline="\n")


def test_a_stale_log_is_refused_with_what_changed(here: Path) -> None:
    measure(here, MEANS)
    edit(here / "rarms.yaml", "work: 61.6 ms", "work: 62 ms")
    edit(here / "vision.py", "print()", "pass")

    answer = rarms("plan", "-f", str(here))

    assert answer.code == 4
    assert "error[RARMS102]" in answer.err
    assert "file vision.py changed; vision.simulation.work: 61.6 ms -> 62 ms" in " ".join(answer.err.split())


def test_little_memory_and_another_governor_are_warnings(here: Path) -> None:
    seen = SettingEvidence(elapsed_ms=1.0, memory_peak=480 * 2**20, speeds=(MachineSpeed(governor="performance"),) * 2)
    settings = [replace(a_setting(reserve, steady("vision", mean)), evidence=seen) for reserve, mean in MEANS.items()]
    leave_log(here, ["vision"], settings)

    answer = rarms("plan", "-f", str(here))

    assert "warning[RARMS127]" in answer.out
    assert "vision used up to 480 MiB in the measurement, and has 512 MiB." in " ".join(answer.out.split())
    assert "Write `memory: 576 MiB` or more" in " ".join(answer.out.split())
    assert "RARMS105" not in answer.out, "the simulated host has no governor"

    manifest = load_manifest(ManifestSource(manifest=str(here)))
    onboard = unseen(manifest.system.hosts["onboard"], "robot")
    host = replace(onboard, state=State(facts=replace(onboard.facts, governor="powersave")))
    (vision,) = manifest.system.components.values()
    found = measured_reservations(manifest, {}).look_up((vision,), host.host)
    assert isinstance(found, LookedUp)
    (finding,) = other_governor(host, [(("vision",), found)], manifest.places)
    assert finding.detail.startswith("onboard uses the governor powersave; vision was measured with performance.")


def test_components_in_own_folder_outdate_a_log(here: Path) -> None:
    measure(here, MEANS)
    code = here / "code"
    code.mkdir()
    (code / "vision.py").write_text("pass\n", encoding="utf-8")

    manifest = load_manifest(ManifestSource(manifest=str(here), code=str(code)))

    assert why_outdated(manifest, manifest.system.hosts["onboard"], ("vision",)) == "file vision.py changed"


def test_what_changed_has_the_manifests_own_keys(here: Path) -> None:
    measure(here, MEANS)
    lines = "\n      samples: { from: json_lines, response_time: { field: took, unit: s } }"
    edit(here / "rarms.yaml", "until: { samples: 200 }", "until: { samples: 200 }" + lines)

    said = " ".join(rarms("plan", "-f", str(here)).err.split())

    assert (
        "vision.run.samples.from: not set -> json_lines; vision.run.samples.response_time.field: not set -> took; "
        "vision.run.samples.response_time.unit: not set -> s" in said
    )


@pytest.mark.parametrize(("before", "after"), [("simulated", "hyperv"), ("linux", "simulated")])
def test_simulated_figures_never_hold_for_real_hosts(before: str, after: str) -> None:
    advice = stale_advice([Changed(part="provider", before=before, after=after)], ("vision",))

    assert str(advice).startswith("Measurements on a simulated host are never valid for a real one.")
    assert [each.text for each in advice.commands] == ["rarms measure vision --again"]


def test_chosen_apt_and_another_criticality_make_nothing_stale(here: Path) -> None:
    measure(here, MEANS)
    edit(here / "rarms.yaml", "at_most: 100 ms", "at_most: 90 ms")
    edit(here / "rarms.yaml", "criticality: 30", "criticality: 99")
    edit(here / "rarms.yaml", "samples: 200", "samples: 300")
    edit(here / "rarms.yaml", "work: 61.6 ms, blocked: 26.4 ms", "blocked: 26.4 ms, work: 61.60 ms")

    answer = rarms("plan", "-f", str(here))

    assert answer.code == 0
    assert "1.4 LP" in answer.out


def test_missing_files_are_notes_and_builds_warnings(here: Path) -> None:
    measure(here, MEANS, build=20348)
    (here / "vision.py").unlink()

    answer = rarms("plan", "-f", str(here))

    told = answer.out + answer.err
    assert answer.code == 0
    assert "note[RARMS104]" in told
    assert "warning[RARMS105]" in told
    assert "build of the operating system: 20348 -> 26100" in " ".join(told.split())


def test_damaged_or_unmet_log_is_no(here: Path) -> None:
    path = measure(here, {50: 400.0, 100: 300.0})

    unmet = rarms("plan", "-f", str(here))
    path.write_bytes(path.read_bytes().replace(b'"reserve":50', b'"reserve":51'))
    damaged = rarms("plan", "-f", str(here))

    assert (unmet.code, damaged.code) == (4, 4)
    assert "even at 100 % of its VPs" in " ".join(unmet.err.split())
    assert "error[RARMS107]" in damaged.err
    assert "line 2" in damaged.err


def test_level_advice_names_the_index(here: Path) -> None:
    measure(here, {50: 400.0, 100: 300.0})
    advised_of_one = rarms("plan", "-f", str(here)).err
    edit(here / "rarms.yaml", "    run:\n", "      p95_response_time: { at_most: 2 s }\n    run:\n")

    several = rarms("plan", "-f", str(here)).err

    assert "--at LEVEL --index mean_response_time" in " ".join(several.split())
    assert "--index" not in advised_of_one


def test_drift_and_graph_look_the_same_logs_up(here: Path) -> None:
    assert rarms("graph", "-f", str(here)).code == 4
    measure(here, MEANS)

    assert "62 %" in rarms("graph", "-f", str(here)).out
    assert rarms("apply", "-f", str(here), "--auto-approve").code == 0
    assert rarms("drift", "-f", str(here)).code == 0
    assert rarms("plan", "-f", str(here)).code == 0
    edit(here / "rarms.yaml", "at_most: 100 ms", "at_most: 110 ms")
    assert rarms("drift", "-f", str(here)).code == 5


def test_unseen_bench_facts_are_not_compared() -> None:
    now = known_platform(a_host())

    assert (now.smt, now.scheduler, now.processor, now.os_build) == (None, None, None, None)
