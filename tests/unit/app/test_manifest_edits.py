"""Compounds written into `partitions`: comments kept, entries of emptied partitions gone, in the file that says it."""

from collections.abc import Sequence
from datetime import date
from pathlib import Path

import pytest
from hypothesis import given
from hypothesis import strategies as st

from rarms_iac.app.manifest_files import (
    FileEdit,
    edit_partitions,
    emptied_partitions,
    initial_manifest,
    name_from,
    write_edits,
    write_first_manifest,
)
from rarms_iac.app.manifests import Manifest, load_manifest
from rarms_iac.app.requests import ManifestSource
from rarms_iac.app.use_case_errors import RequestError
from rarms_iac.manifest.checks import run_checks
from rarms_iac.manifest.edit.formatting import format_text
from rarms_iac.manifest.load import load_system
from rarms_iac.model.names import is_name
from rarms_iac.planner.combining.oracle import Coi

MANIFEST = """\
schema: rarms/v1

application: { name: robot }

hosts:
  onboard: { logical_processors: 2, memory: 4 GiB }

components:
  vision: { criticality: 30, cpu: { reserve: 40 % } } # sees
  paths: { criticality: 20, cpu: { reserve: 30 % } }
  video: { criticality: 10, cpu: { reserve: 20 % } }
"""

PARTITIONS = """
partitions: # by hand
  front: # the camera's
    components: [vision]
    start: manual
  video:
    start: manual
"""


def manifest(folder: Path, *overlays: str) -> Manifest:
    source = ManifestSource(
        manifest=str(folder / "rarms.yaml"),
        overlays=tuple(str(folder / overlay) for overlay in overlays),
        today=date(2026, 11, 21),
    )
    return load_manifest(source)


def compound(name: str, *members: str) -> Coi:
    return Coi(name=name, members=tuple(sorted(members)), criticality=30, processors=2, reserve=50)


def write(folder: Path, text: str, name: str = "rarms.yaml") -> None:
    (folder / name).write_text(text, encoding="utf-8", newline="\n")


def write_partitions(manifest: Manifest, compounds: Sequence[Coi]) -> tuple[list[str], list[str]]:
    """The files that are written, and the entries that go."""
    edits = edit_partitions(manifest, compounds)
    write_edits(edits)
    return [edit.file for edit in edits], list(emptied_partitions(manifest.system, compounds))


def test_a_section_is_made_where_there_is_none(tmp_path: Path) -> None:
    write(tmp_path, MANIFEST)
    files, removed = write_partitions(manifest(tmp_path), [compound("paths", "video", "paths")])

    assert (files, removed) == ([(tmp_path / "rarms.yaml").as_posix()], [])
    text = (tmp_path / "rarms.yaml").read_text(encoding="utf-8")
    assert text == MANIFEST + "\npartitions:\n  paths:\n    components: [paths, video]\n"
    assert manifest(tmp_path).system.partitions["paths"].components == ("paths", "video")


def test_existing_partition_is_extended_and_emptied_one_goes(tmp_path: Path) -> None:
    write(tmp_path, MANIFEST + PARTITIONS)
    files, removed = write_partitions(manifest(tmp_path), [compound("front", "video", "vision")])

    assert (files, removed) == ([(tmp_path / "rarms.yaml").as_posix()], ["video"])
    text = (tmp_path / "rarms.yaml").read_text(encoding="utf-8")
    assert text.endswith(
        "partitions: # by hand\n  front: # the camera's\n    components: [vision, video]\n    start: manual\n"
    )


def test_comments_of_removed_entry_stay_above_compounds(tmp_path: Path) -> None:
    text = MANIFEST + (
        "\n# by hand\npartitions: # top\n  # plays films\n  video: # of the kiosk\n    start: manual # not at night\n"
    )
    write(tmp_path, text)
    files, removed = write_partitions(manifest(tmp_path), [compound("paths", "video", "paths")])

    assert (files, removed) == ([(tmp_path / "rarms.yaml").as_posix()], ["video"])
    assert (tmp_path / "rarms.yaml").read_text(encoding="utf-8") == MANIFEST + (
        "\n# by hand\npartitions: # top\n  # plays films\n  # of the kiosk\n  # not at night\n"
        "  paths:\n    components: [paths, video]\n"
    )


def test_comments_of_lone_overlay_partition_stay(tmp_path: Path) -> None:
    write(tmp_path, MANIFEST + "\npartitions:\n  vision: { start: manual }\n")
    write(tmp_path, "schema: rarms/v1\npartitions:\n  # films\n  video: { start: manual } # nights\n", "night.yaml")
    write_partitions(manifest(tmp_path, "night.yaml"), [compound("vision", "video", "vision")])

    night = (tmp_path / "night.yaml").read_text(encoding="utf-8")
    assert (night.count("# films"), night.count("# nights"), "video" in night) == (1, 1, False)
    assert manifest(tmp_path, "night.yaml").system.partitions["vision"].components == ("vision", "video")


def test_what_an_overlay_says_is_changed_there(tmp_path: Path) -> None:
    write(tmp_path, MANIFEST)
    write(tmp_path, "schema: rarms/v1\npartitions:\n  front:\n    components: [vision]\n", "robot-7.yaml")
    write_partitions(manifest(tmp_path, "robot-7.yaml"), [compound("front", "paths", "vision")])

    assert (tmp_path / "rarms.yaml").read_text(encoding="utf-8") == MANIFEST
    assert "components: [vision, paths]" in (tmp_path / "robot-7.yaml").read_text(encoding="utf-8")
    assert manifest(tmp_path, "robot-7.yaml").system.partitions["front"].components == ("vision", "paths")


def test_nothing_new_writes_nothing(tmp_path: Path) -> None:
    write(tmp_path, MANIFEST + PARTITIONS)
    assert write_partitions(manifest(tmp_path), []) == ([], [])


def test_concurrent_edit_is_not_overwritten(tmp_path: Path) -> None:
    first, file = tmp_path / "overlay.yaml", tmp_path / "rarms.yaml"
    first.write_text("as it was read\n", encoding="utf-8", newline="\n")
    file.write_text("by another hand\n", encoding="utf-8", newline="\n")
    edits = [FileEdit(file=str(each), before="as it was read\n", after="after the change\n") for each in (first, file)]

    with pytest.raises(RequestError, match="was changed in the meantime, so nothing was written"):
        write_edits(edits)

    assert first.read_text(encoding="utf-8") == "as it was read\n", "all or nothing"
    assert file.read_text(encoding="utf-8") == "by another hand\n"


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
