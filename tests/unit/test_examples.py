"""Every example in manifests/ is what it shows: valid, canonical, and runnable where it says that it runs."""

import json
import subprocess
import sys
from dataclasses import replace
from datetime import date
from pathlib import Path
from typing import Any

import jsonschema
import pytest

from rarms_iac.app.data_logs import measured_reservations
from rarms_iac.app.manifests import Manifest
from rarms_iac.app.requests import ManifestSource
from rarms_iac.applying.execute import apply_plan
from rarms_iac.applying.make_plan import PlanningResult, make_plan
from rarms_iac.applying.plan_request import PlanRequest
from rarms_iac.applying.run_report import RunEnding
from rarms_iac.applying.run_steps import hold
from rarms_iac.manifest.checks import run_checks
from rarms_iac.manifest.document.schema import manifest_schema
from rarms_iac.manifest.edit.formatting import format_text
from rarms_iac.manifest.load import Loaded, load_system
from rarms_iac.manifest.text.reading import read_text
from rarms_iac.model.diagnostics import Severity
from rarms_iac.model.plan import Plan
from rarms_iac.model.state import RunState
from rarms_iac.model.system import Measured
from rarms_iac.providers.simulated.provider import SimulatedHostProvider
from rarms_iac.storage.shipped import shipped
from tests.builders import ORIGIN
from tests.files import copy_files
from tests.measuring import leave_logs

MANIFESTS = shipped("manifests")
EXAMPLES = sorted(path.parent.name for path in MANIFESTS.glob("*/rarms.yaml"))
TEXTS = sorted(path.relative_to(MANIFESTS).as_posix() for path in MANIFESTS.glob("*/*.yaml"))
ROBOT = MANIFESTS / "delivery-robot"
TODAY = date(2026, 11, 21)


MEASURED = {
    "delivery-robot": {"face-detection": 63, "speech-recognition": 17, "path-planning": 10, "video-streaming": 9},
    "over-full": {"people-detection": 58, "label-reading": 17, "path-following": 22, "stock-messages": 18},
}
"""What `rarms measure` found of each, to a per cent or two: enough to plan with."""


ELSEWHERE = {"delivery-robot-linux", "hyperv-cell", "over-full", "ros-robot"}
"""They cannot be applied to a simulated host, or do not fit: other tests, or `make demo-linux`, apply them."""


def loaded(example: str, *overlays: str) -> Loaded:
    folder = MANIFESTS / example
    return load_system(
        str(folder / "rarms.yaml"), [str(folder / overlay) for overlay in overlays], today=TODAY, checks=run_checks
    )


def test_the_examples_that_were_promised_are_there() -> None:
    assert {
        "delivery-robot",
        "delivery-robot-linux",
        "over-full",
        "two-hosts",
        "fleet",
        "hyperv-cell",
        "partitions",
    } <= set(EXAMPLES)
    index = (MANIFESTS / "README.md").read_text(encoding="utf-8")
    assert all(f"({example}/rarms.yaml)" in index for example in EXAMPLES)


@pytest.mark.parametrize(
    ("example", "overlays"),
    [*((example, ()) for example in EXAMPLES), ("fleet", ("robot-1.yaml",)), ("fleet", ("robot-7.yaml",))],
)
def test_an_example_has_nothing_to_complain_about(example: str, overlays: tuple[str, ...]) -> None:
    result = loaded(example, *overlays)

    assert result.system is not None
    assert [diagnostic for diagnostic in result.diagnostics if diagnostic.severity is not Severity.NOTE] == []


@pytest.mark.parametrize("text", TEXTS)
def test_example_is_canonical_and_says_what_it_shows(text: str) -> None:
    written = (MANIFESTS / text).read_bytes().decode()

    assert format_text(written, text) == written
    assert written.startswith("# ")


@pytest.mark.parametrize("example", EXAMPLES)
def test_example_is_valid_for_any_json_schema_library(example: str) -> None:
    values = read_text((MANIFESTS / example / "rarms.yaml").read_bytes(), example, "").value

    assert list(jsonschema.Draft202012Validator(manifest_schema()).iter_errors(values)) == []


def test_robot_has_the_papers_four_components() -> None:
    system = loaded("delivery-robot").system

    assert system is not None
    assert set(system.components) == {"face-detection", "speech-recognition", "path-planning", "video-streaming"}
    assert {component.cpu.reserve for component in system.components.values()} == {Measured.MEASURED}
    assert "busy-loop" in system.interference


def test_overlays_change_what_they_say_and_nothing_else() -> None:
    base, first, seven = (
        loaded("fleet").system,
        loaded("fleet", "robot-1.yaml").system,
        loaded("fleet", "robot-7.yaml").system,
    )

    assert base is not None
    assert first is not None
    assert seven is not None
    assert set(base.components) - set(first.components) == {"door-opening"}
    assert set(seven.components) - set(base.components) == {"arm"}
    assert (first.hosts["onboard"].logical_processors, seven.hosts["onboard"].logical_processors) == (2, 4)


def _prepared(result: Loaded, hosts: dict[str, SimulatedHostProvider], folder: Path) -> PlanningResult:
    """A plan from the data logs below the folder."""
    assert result.system is not None
    states = {name: host.observe() for name, host in hosts.items()}
    loaded = replace(result, folder=str(folder))
    beside = Manifest(source=ManifestSource(), system=result.system, loaded=loaded)
    request = PlanRequest(
        system=result.system,
        places=result.places,
        manifest="rarms.yaml",
        manifest_digest=result.digest,
        today=TODAY,
        reservations=measured_reservations(beside, states),
    )
    return make_plan(request, states)


def _plan(result: Loaded, hosts: dict[str, SimulatedHostProvider], folder: Path) -> Plan:
    prepared = _prepared(result, hosts, folder)
    assert prepared.plan is not None, prepared.findings
    assert [finding for finding in prepared.findings if finding.severity is Severity.ERROR] == []
    return prepared.plan


@pytest.mark.parametrize(
    ("example", "overlays"),
    [
        *((example, ()) for example in EXAMPLES if example not in ELSEWHERE),
        ("fleet", ("robot-1.yaml",)),
        ("fleet", ("robot-7.yaml",)),
    ],
)
def test_example_is_planned_and_applied_wholly(example: str, overlays: tuple[str, ...], tmp_path: Path) -> None:
    result = loaded(example, *overlays)
    assert result.system is not None
    hosts = {name: SimulatedHostProvider(host, tmp_path / f"{name}.json") for name, host in result.system.hosts.items()}
    measured_example(example, tmp_path)
    plan = _plan(result, hosts, tmp_path)
    assert any(part.steps for part in plan.hosts)

    with hold(tuple(hosts.values()), "ann@lab", 0):
        report = apply_plan(plan, hosts, ORIGIN)

    assert (report.ending, report.findings) == (RunEnding.DONE, ())
    assert [part.steps for part in _plan(result, hosts, tmp_path).hosts] == [() for _ in hosts]


def measured_example(example: str, folder: Path) -> None:
    """Data logs of the example below the folder, as `rarms measure` leaves them beside it."""
    if example in MEASURED:
        copy_files(MANIFESTS / example, folder)
        leave_logs(folder, MEASURED[example])


def test_four_demanding_components_do_not_fit(tmp_path: Path) -> None:
    result = loaded("over-full")
    assert result.system is not None
    hosts = {name: SimulatedHostProvider(host, tmp_path / f"{name}.json") for name, host in result.system.hosts.items()}
    measured_example("over-full", tmp_path)

    prepared = _prepared(result, hosts, tmp_path)

    assert prepared.plan is None
    assert [finding.code for finding in prepared.findings if finding.severity is Severity.ERROR] == ["RARMS014"]


def test_protected_manual_and_shared_partition_are_there(tmp_path: Path) -> None:
    result = loaded("partitions")
    assert result.system is not None
    host = SimulatedHostProvider(result.system.hosts["kiosk"], tmp_path / "kiosk.json")

    with hold((host,), "ann@lab", 0):
        apply_plan(_plan(result, {"kiosk": host}, tmp_path), {"kiosk": host}, ORIGIN)

    running = {partition.settings.name: partition.state for partition in host.observe().partitions}
    assert running == {"voice": RunState.RUNNING, "payment": RunState.RUNNING, "maintenance": RunState.OFF}


def _output(program: str, jobs: int) -> list[str]:
    command = [sys.executable, "-B", f"components/{program}.py", str(jobs)]
    done = subprocess.run(command, cwd=ROBOT, capture_output=True, text=True, encoding="utf-8", timeout=60, check=True)
    return done.stdout.splitlines()


def test_faces_are_found_where_they_are() -> None:
    samples: list[Any] = [json.loads(line) for line in _output("face_detection", 3)]

    assert [sample["found"] for sample in samples] == [True, True, True]
    assert all(sample["response"] > 0 for sample in samples)


def test_commands_are_understood_in_form_that_manifest_reads() -> None:
    import re2

    system = loaded("delivery-robot").system
    assert system is not None
    run = system.components["speech-recognition"].run
    assert run is not None
    found = [re2.search(run.samples.pattern, line) for line in _output("speech_recognition", 20)]

    assert sum(match is not None and match["success"] == "1" for match in found) >= 19
    assert all(match is not None and float(match["response"]) > 0 for match in found)


def test_video_is_streamed_frame_by_frame() -> None:
    frames: list[Any] = [json.loads(line) for line in _output("video_streaming", 3)]

    assert [frame["frames"] for frame in frames] == [1, 1, 1]
    assert all(0 < frame["bytes"] < 320 * 240 for frame in frames)


def test_ways_are_planned_around_obstacles() -> None:
    code = (
        "from components.path_planning import SIZE, plan, shortest\n"
        "goal = (SIZE - 1, SIZE - 1)\n"
        "assert shortest(set(), (0, 0), goal) == 2 * (SIZE - 1) + 2, 'straight, one turn, straight'\n"
        "assert shortest({(1, 0), (0, 1)}, (0, 0), goal) is None, 'walled in'\n"
        "assert plan() > 2 * (SIZE - 1)\n"
    )

    done = subprocess.run([sys.executable, "-B", "-c", code], cwd=ROBOT, capture_output=True, text=True, timeout=60)

    assert (done.returncode, done.stderr) == (0, "")
