"""Owner and rights of the files that are written."""

import os
from pathlib import Path

import pytest

from rarms_iac.app.files import make_folder, write_file
from tests.needs import require
from tests.unit.cli.running import rarms

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
@pytest.mark.parametrize("mask", [0, 0o002, 0o022, 0o077])
def test_kept_files_are_never_world_writable(tmp_path: Path, mask: int) -> None:
    manifest = "schema: rarms/v1\napplication: { name: cell }\n"
    manifest += "hosts: { onboard: { logical_processors: 2, memory: 4 GiB } }\n"
    Path(tmp_path, "rarms.yaml").write_text(
        manifest + "components: { vision: { criticality: 1, memory: 64 MiB, cpu: { reserve: 10 % } } }\n", "utf-8"
    )
    before = os.umask(mask)
    try:
        answer = rarms("apply", "-f", str(tmp_path / "rarms.yaml"), "--auto-approve")
    finally:
        os.umask(before)

    made = [path for path in tmp_path.rglob("*") if path.name != "rarms.yaml"]
    assert answer.code == 0, answer.err
    assert {"onboard.json", "onboard.journal.jsonl"} <= {path.name for path in made}
    assert [path for path in made if path.stat().st_mode & 0o002] == []


@pytest.mark.needs("posix")
def test_what_root_writes_stays_the_users(tmp_path: Path) -> None:
    require("root")
    file, new = tmp_path / "rarms.yaml", tmp_path / "new.yaml"
    file.touch()
    os.chown(file, NOBODY, NOBODY)
    os.chown(tmp_path, NOBODY, NOBODY)

    write_file(str(file), b"new")
    write_file(str(new), b"new")
    make_folder(str(tmp_path / "a" / "b"))

    made = (file, new, tmp_path / "a", tmp_path / "a" / "b")
    assert [(path.stat().st_uid, path.stat().st_gid) for path in made] == [(NOBODY, NOBODY)] * 4
