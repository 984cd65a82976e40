"""What the Action installs is held with hashes, which `scripts/lock` writes: all that rarms needs and is built with."""

import re
import tomllib
from pathlib import Path
from typing import Any

import jsonschema
import pytest
import yaml
from packaging.requirements import Requirement
from packaging.utils import canonicalize_name

from rarms_iac.manifest.document.schema import manifest_schema
from rarms_iac.manifest.edit.formatting import format_text
from rarms_iac.manifest.text.reading import read_text
from scripts.check_style import breaches_in
from scripts.commands_reference import reference
from scripts.manifest_reference import examples, reference_markdown

ROOT = Path(__file__).parents[3]
LOCK = (ROOT / "locked-requirements.txt").read_text(encoding="utf-8")
LINES = [line for line in LOCK.replace("\\\n", "").splitlines() if not line.startswith("#")]


def locked() -> dict[str, list[Requirement]]:
    """The pinned requirements, by name."""
    by_name: dict[str, list[Requirement]] = {}
    for line in LINES:
        requirement = Requirement(re.split(r"\s+--hash", line)[0])
        by_name.setdefault(canonicalize_name(requirement.name), []).append(requirement)
    return by_name


def test_every_dependency_is_locked_within_its_bounds() -> None:
    project = tomllib.loads((ROOT / "pyproject.toml").read_text(encoding="utf-8"))
    wanted = [*project["project"]["dependencies"], *project["build-system"]["requires"]]
    held = locked()
    for requirement in map(Requirement, wanted):
        for pin in held[canonicalize_name(requirement.name)]:
            (version,) = pin.specifier
            assert version.operator == "=="
            assert requirement.specifier.contains(version.version), f"{requirement}: run make lock"


def test_locked_versions_have_hashes() -> None:
    for line in LINES:
        assert re.search(r"--hash=sha256:[0-9a-f]{64}\b", line), line
    assert "://" not in LOCK
    assert "index" not in LOCK


def test_the_action_installs_by_these_hashes_alone() -> None:
    action = yaml.safe_load((ROOT / "action.yml").read_text(encoding="utf-8"))
    (install,) = [step["run"] for step in action["runs"]["steps"] if step["name"] == "Install rarms"]
    installs = [line for line in install.splitlines() if "pip" in line and " install " in line]
    assert len(installs) == 2
    assert '--require-hashes -r "$GITHUB_ACTION_PATH/locked-requirements.txt"' in installs[0]
    assert "--no-deps --no-build-isolation" in installs[1]


_NAMED = {"Host", "Component", "PartitionRequest", "TaskRequest", "Acceptance"}
_NAMED |= {"BusyLoop", "Bursts", "Browser", "CommandLoad", "Stress"}


def test_the_page_is_the_generated_one() -> None:
    page = Path(__file__).parents[3] / "docs" / "manifest.md"

    assert page.read_text(encoding="utf-8") == reference_markdown()


def test_every_key_is_on_the_page() -> None:
    page = reference_markdown()

    for block in _blocks().values():
        assert all(f"| `{key}` |" in page for key in block["properties"])
        assert block["description"] in page


@pytest.mark.parametrize("name", examples())
def test_every_example_is_valid_and_canonical(name: str) -> None:
    text = examples()[name]
    value: Any = read_text(text.encode(), "example", "").value
    if name != "System":
        value = next(iter(value.values()))
    document = manifest_schema()
    schema = document if name == "System" else document["$defs"].get(name)
    if name == "apt":
        schema = document["$defs"]["Component"]["properties"]["apt"]

    for entry in value.values() if name in _NAMED else [value]:
        jsonschema.validate(entry, {**schema, "$defs": document["$defs"]})
    assert format_text(text, "example") == text


def _blocks() -> dict[str, Any]:
    return {name: shape for name, shape in manifest_schema()["$defs"].items() if "properties" in shape}


@pytest.mark.parametrize(
    ("planted", "breach"),
    [
        ('value = finding.message.removeprefix("it is locked by ")', "this reads a sentence"),
        ('value = "rarms plan" in finding.advice', "this reads a sentence"),
        ("text = path.read_text()", "this opens a file"),
        ('file = path.open("rb")', "this opens a file"),
        ("file = os.open(path, 0)", "this opens a file"),
        ("class Host: ...\n\n\nclass Host: ...", "class Host is also in"),
        ("from tests.builders import a_system", "the package is installed without benchmarks and tests"),
    ],
)
def test_a_breach_is_found(tmp_path: Path, planted: str, breach: str) -> None:
    (tmp_path / "plan.py").write_text(f"{planted}\n", encoding="utf-8")

    (found,) = breaches_in(tmp_path)
    assert breach in found


@pytest.mark.parametrize(
    "planted",
    [
        'value = line.startswith("ready")',
        "file = os.open(os.devnull, 0)",
        'value = f"{finding.detail} {finding.advice}"',
    ],
)
def test_other_code_is_not(tmp_path: Path, planted: str) -> None:
    (tmp_path / "plan.py").write_text(f"{planted}\n", encoding="utf-8")

    assert list(breaches_in(tmp_path)) == []


PAGE = Path(__file__).parents[3] / "docs" / "commands.md"


@pytest.mark.skipif(not PAGE.parent.is_dir(), reason="the documentation is not beside these tests")
def test_page_of_commands_is_what_commands_say() -> None:
    assert PAGE.read_text(encoding="utf-8") == reference(), (
        "run: python -m scripts.commands_reference > docs/commands.md"
    )
