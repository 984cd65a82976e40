"""`rarms init` that was killed anywhere can be run again."""

from contextlib import suppress
from pathlib import Path

import pytest

from rarms_iac.app.manifest_files import write_first_manifest
from rarms_iac.storage import disk
from tests.crashing import Crash, CrashingDisk, When


@pytest.mark.parametrize("when", When)
@pytest.mark.parametrize("at", range(1, 13))
def test_init_goes_on_where_it_was_killed(tmp_path: Path, at: int, when: When) -> None:
    folder = tmp_path / "robot"
    with disk.use(CrashingDisk(at, when)), suppress(Crash):
        write_first_manifest(str(folder))
    is_done = (folder / "rarms.yaml").exists()

    if not is_done:
        write_first_manifest(str(folder))

    assert {file.name for file in folder.iterdir() if not file.name.endswith(".new")} == {
        ".gitattributes",
        "rarms.yaml",
        "rarms.schema.json",
    }


def test_a_line_is_added_to_git_attributes_once(tmp_path: Path) -> None:
    attributes = tmp_path / ".gitattributes"
    attributes.write_bytes(b"*.png binary")

    for _ in range(2):
        write_first_manifest(str(tmp_path))
        (tmp_path / "rarms.yaml").unlink()

    assert attributes.read_text().splitlines() == ["*.png binary", "/measurements/**/*.jsonl merge=union"]
