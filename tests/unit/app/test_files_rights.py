"""Owner and rights of the files that are written."""

import os
from pathlib import Path

import pytest

from rarms_iac.app.files import write_file
from tests.needs import require

NOBODY = 65534


@pytest.mark.needs("posix")
@pytest.mark.parametrize("mode", [0o600, 0o640, 0o755])
def test_a_file_that_is_replaced_keeps_its_rights(tmp_path: Path, mode: int) -> None:
    file = tmp_path / "rarms.yaml"
    file.touch()
    file.chmod(mode)

    write_file(str(file), b"new")

    assert file.stat().st_mode & 0o777 == mode


@pytest.mark.needs("posix")
def test_what_root_writes_stays_the_users(tmp_path: Path) -> None:
    require("root")
    file, new = tmp_path / "rarms.yaml", tmp_path / "new.yaml"
    file.touch()
    os.chown(file, NOBODY, NOBODY)
    os.chown(tmp_path, NOBODY, NOBODY)

    write_file(str(file), b"new")
    write_file(str(new), b"new")

    assert [(path.stat().st_uid, path.stat().st_gid) for path in (file, new)] == [(NOBODY, NOBODY)] * 2
