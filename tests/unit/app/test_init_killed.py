"""`rarms init` that was killed anywhere can be run again."""

from contextlib import suppress
from pathlib import Path

import pytest

from rarms_iac.app.manifest_files import write_first_manifest
from rarms_iac.storage import disk
from tests.crashing import Crash, CrashingDisk, When


@pytest.mark.parametrize("when", When)
@pytest.mark.parametrize("at", range(1, 9))
def test_init_goes_on_where_it_was_killed(tmp_path: Path, at: int, when: When) -> None:
    folder = tmp_path / "robot"
    with disk.use(CrashingDisk(at, when)), suppress(Crash):
        write_first_manifest(str(folder))
    is_done = (folder / "rarms.yaml").exists()

    if not is_done:
        write_first_manifest(str(folder))

    assert {file.name for file in folder.iterdir() if not file.name.startswith(".")} == {
        "rarms.yaml",
        "rarms.schema.json",
    }
