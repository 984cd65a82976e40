"""Owner and rights of the files that are written."""

import os
from pathlib import Path

import pytest

from rarms_iac.app.files import make_folder, write_file
from rarms_iac.storage.disk import NotRegular, advice_on, make_folders
from rarms_iac.storage.writing import append, replace
from tests.needs import require
from tests.unit.cli.running import rarms
from tests.unit.cli.test_status import MANIFEST, MEASURED

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


ADVICE = "Replace the link with a copy or a mount of its target."


@pytest.fixture
def outside(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    checkout, outside = tmp_path / "checkout", tmp_path / "outside"
    for folder in (checkout / ".git", outside):
        folder.mkdir(parents=True)
    monkeypatch.chdir(checkout)
    Path("rarms.yaml").write_text(MANIFEST.partition("  vision:")[0] + MEASURED, encoding="utf-8")
    return outside


@pytest.mark.needs("posix")
@pytest.mark.parametrize("name", [".rarms", "measurements"])
def test_linked_folder_is_not_written_through(outside: Path, name: str) -> None:
    Path(name).symlink_to(outside)

    answer = rarms("measure", "--samples", "60")

    assert answer.code not in {0, 70}
    assert "a link that leads out of the repository" in " ".join(answer.err.split())
    assert ADVICE in " ".join(answer.err.split())
    assert not any(outside.iterdir())


@pytest.mark.needs("posix")
def test_simulated_host_is_not_changed_through_link(outside: Path) -> None:
    Path("rarms.yaml").write_text(MANIFEST, encoding="utf-8")
    Path(".rarms").symlink_to(outside)

    answer = rarms("apply", "--auto-approve")

    assert answer.code not in {0, 70}
    assert ADVICE in " ".join(answer.err.split())
    assert not any(outside.iterdir())


@pytest.mark.needs("posix")
@pytest.mark.parametrize("name", [".rarms", "measurements"])
def test_writers_refuse_link_out_of_repository(outside: Path, name: str) -> None:
    Path(name).symlink_to(outside)

    with pytest.raises(NotRegular, match="a link that leads out of the repository"):
        replace(Path(name, "file"), b"")
    with pytest.raises(NotRegular, match="a link that leads out of the repository"):
        append(Path(name, "file"), {"name": "value"})
    with pytest.raises(NotRegular, match="a link that leads out of the repository"):
        make_folders(Path(name, "folder"))
    assert not any(outside.iterdir())


@pytest.mark.needs("posix")
def test_link_to_another_folder_of_repository_is_followed(outside: Path) -> None:
    Path("elsewhere").mkdir()
    Path("measurements").symlink_to("elsewhere")

    assert rarms("measure", "--samples", "60").code == 0
    assert list(Path("elsewhere").rglob("*.jsonl"))
    assert not any(outside.iterdir())


@pytest.mark.needs("posix")
@pytest.mark.parametrize(
    ("error", "advice"),
    [
        (NotRegular("file", "a folder"), "Replace it with a regular file."),
        (PermissionError(13, "Permission denied"), "Run rarms as the owner of the file, or correct the permissions."),
        (OSError(28, "No space left on device"), "Make room."),
    ],
)
def test_the_advice_fits_what_is_in_the_way(error: OSError, advice: str) -> None:
    assert advice_on(error, "Make room.") == advice
