"""Code scanning refuses a SARIF file for one result without a location: every command that writes it has them all."""

import json
from collections.abc import Iterator
from datetime import date
from pathlib import Path
from typing import Any

import click
import jsonschema
import pytest

from rarms_iac.cli.group import COMMANDS, load_command
from rarms_iac.manifest.load import load_system
from rarms_iac.texts.findings import Finding
from rarms_iac.views.finding_forms import with_places
from tests.needs import require
from tests.unit.cli.running import rarms
from tests.unit.views.test_finding_forms import SARIF_SCHEMA

ROOT = Path(__file__).parents[3]
CELL = ROOT / "manifests" / "hyperv-cell"
CASES = ROOT / "tests" / "cases"
TODAY = date(2026, 11, 28)


def commands_with_sarif() -> Iterator[str]:
    for name in COMMANDS:
        for option in load_command(name).params:
            if isinstance(option, click.Option) and "sarif" in (option.help or ""):
                yield name


def written(command: str, folder: Path, tmp_path: Path) -> list[tuple[str, str, int]]:
    """The code, file and line of each result."""
    file = tmp_path / f"{command}.sarif"
    snapshot = ("--snapshot", str(folder / "host.json")) if command != "validate" and folder.is_dir() else ()
    manifest = (str(folder),) if command == "validate" else ("-f", str(folder))

    rarms(command, *manifest, *snapshot, "--output", f"sarif={file}")

    log = json.loads(file.read_text(encoding="utf-8"))
    if SARIF_SCHEMA.is_file():
        jsonschema.Draft4Validator(json.loads(SARIF_SCHEMA.read_text(encoding="utf-8"))).validate(log)
    found = []
    for result in log["runs"][0]["results"]:
        (location,) = result["locations"]
        place = location["physicalLocation"]
        name = place["artifactLocation"]["uri"].rpartition("/")[2]
        found.append((result["ruleId"], name, place["region"]["startLine"]))
    return found


def test_three_commands_write_sarif() -> None:
    assert set(commands_with_sarif()) == {"validate", "doctor", "plan"}


@pytest.mark.parametrize("command", ["validate", "doctor", "plan"])
@pytest.mark.parametrize(
    "folder",
    [CELL, *(CASES / name for name in ("stranger-of-the-name", "no-rights", "task-class-with-bytes"))],
    ids=lambda folder: folder.name,
)
def test_every_result_has_a_location(command: str, folder: Path, tmp_path: Path) -> None:
    require("posix")

    assert all(name == "rarms.yaml" and line >= 1 for _, name, line in written(command, folder, tmp_path))


def test_location_is_line_that_names_host_or_partition(tmp_path: Path) -> None:
    folder = CASES / "stranger-of-the-name"
    lines = (folder / "rarms.yaml").read_text(encoding="utf-8").splitlines()
    cell = (CELL / "rarms.yaml").read_text(encoding="utf-8").splitlines()

    assert [lines[line - 1].strip().partition(":")[0] for _, _, line in written("plan", folder, tmp_path)] == ["vision"]
    hosts = [cell[line - 1].strip() for code, _, line in written("plan", CELL, tmp_path) if code == "RARMS223"]
    assert hosts == ["cell:"]


def test_manifest_that_is_not_there_has_location(tmp_path: Path) -> None:
    missing = tmp_path / "robot" / "other.yaml"

    for command in ("validate", "plan"):
        assert [(name, line) for _, name, line in written(command, missing, tmp_path)] == [("other.yaml", 1)]


@pytest.mark.parametrize(
    ("address", "values", "line"),
    [
        ("partition/speech", {}, 6),
        ("partition/vision", {}, 8),
        ("component/vision", {}, 8),
        ("host/onboard", {}, 4),
        ("machine/4f1c", {"host": "onboard", "name": "stranger"}, 4),
        ("", {"hosts": ("onboard",)}, 4),
        ("", {"host": "onboard", "partition": "speech"}, 6),
        ("task/MotionControl", {}, 1),
        ("host/elsewhere", {}, 1),
    ],
)
def test_addresses_and_values_name_lines(address: str, values: dict[str, Any], line: int, tmp_path: Path) -> None:
    manifest = tmp_path / "rarms.yaml"
    manifest.write_text(
        "schema: rarms/v1\napplication: { name: robot }\nhosts:\n"
        "  onboard: { logical_processors: 2, memory: 4 GiB }\npartitions:\n  speech: { components: [hearing] }\n"
        "components:\n  vision: { criticality: 1 }\n  hearing: { criticality: 2 }\n",
        encoding="utf-8",
    )
    finding = Finding.note("RARMS000", "Something").at(None, "It is so.", "", address=address, **values)

    (placed,) = with_places([finding], load_system(str(manifest), (), today=TODAY).places)

    assert placed.place is not None
    assert placed.place.line == line
