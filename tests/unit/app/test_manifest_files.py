"""What `rarms init` writes."""

from datetime import date
from pathlib import Path

import pytest
from hypothesis import given
from hypothesis import strategies as st

from rarms_iac.app.manifest_files import initial_manifest, name_from, write_first_manifest
from rarms_iac.manifest.checks import run_checks
from rarms_iac.manifest.edit.formatting import format_text
from rarms_iac.manifest.load import load_system
from rarms_iac.model.names import is_name


def test_first_manifest_is_valid_and_canonical(tmp_path: Path) -> None:
    text = initial_manifest("conveyor")
    (tmp_path / "rarms.yaml").write_text(text, encoding="utf-8", newline="\n")

    loaded = load_system(str(tmp_path / "rarms.yaml"), today=date(2026, 11, 21), checks=run_checks)

    assert loaded.diagnostics == ()
    assert loaded.system is not None
    assert loaded.system.application.name == "conveyor"
    assert format_text(text, "rarms.yaml") == text
    assert text.count("#") > 10


@pytest.mark.parametrize(
    ("folder", "name"),
    [
        ("robot", "robot"),
        ("My Robot (2)", "my-robot-2"),
        ("Mein-Ördner", "mein-ordner"),
        ("...", "my-application"),
        ("NUL", "my-application"),
    ],
)
def test_a_folder_gives_its_name(folder: str, name: str) -> None:
    assert name_from(folder) == name


@given(st.text())
def test_any_folder_gives_a_name_that_may_be(folder: str) -> None:
    assert is_name(name_from(folder))


def test_a_line_is_added_to_git_attributes_once(tmp_path: Path) -> None:
    attributes = tmp_path / ".gitattributes"
    attributes.write_bytes(b"*.png binary")

    for _ in range(2):
        write_first_manifest(str(tmp_path))
        (tmp_path / "rarms.yaml").unlink()

    assert attributes.read_text().splitlines() == ["*.png binary", "/measurements/**/*.jsonl merge=union"]
