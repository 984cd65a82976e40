"""A `.rarms` or `measurements` that a link takes out of the repository is not written through."""

from pathlib import Path

import pytest

from rarms_iac.storage.append import append
from rarms_iac.storage.disk import NotRegular, advice_on, make_folders
from rarms_iac.storage.replace import replace
from tests.unit.cli.running import rarms
from tests.unit.cli.test_status import MANIFEST, MEASURED

ADVICE = "Remove the link; what it leads to can be copied or mounted there instead."
pytestmark = pytest.mark.needs("posix")


@pytest.fixture
def outside(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    checkout, outside = tmp_path / "checkout", tmp_path / "outside"
    for folder in (checkout / ".git", outside):
        folder.mkdir(parents=True)
    monkeypatch.chdir(checkout)
    Path("rarms.yaml").write_text(MANIFEST.partition("  vision:")[0] + MEASURED, encoding="utf-8")
    return outside


@pytest.mark.parametrize("name", [".rarms", "measurements"])
def test_linked_folder_is_not_written_through(outside: Path, name: str) -> None:
    Path(name).symlink_to(outside)

    answer = rarms("measure", "--samples", "60")

    assert answer.code not in {0, 70}
    assert "a link that leads out of the repository" in " ".join(answer.err.split())
    assert ADVICE in " ".join(answer.err.split())
    assert not any(outside.iterdir())


def test_simulated_host_is_not_changed_through_such_link(outside: Path) -> None:
    Path("rarms.yaml").write_text(MANIFEST, encoding="utf-8")
    Path(".rarms").symlink_to(outside)

    answer = rarms("apply", "--auto-approve")

    assert answer.code not in {0, 70}
    assert ADVICE in " ".join(answer.err.split())
    assert not any(outside.iterdir())


@pytest.mark.parametrize("name", [".rarms", "measurements"])
def test_neither_writer_goes_through_it(outside: Path, name: str) -> None:
    Path(name).symlink_to(outside)

    with pytest.raises(NotRegular, match="a link that leads out of the repository"):
        replace(Path(name, "file"), b"")
    with pytest.raises(NotRegular, match="a link that leads out of the repository"):
        append(Path(name, "file"), {"name": "value"})
    with pytest.raises(NotRegular, match="a link that leads out of the repository"):
        make_folders(Path(name, "folder"))
    assert not any(outside.iterdir())


def test_link_to_another_folder_of_repository_is_followed(outside: Path) -> None:
    Path("elsewhere").mkdir()
    Path("measurements").symlink_to("elsewhere")

    assert rarms("measure", "--samples", "60").code == 0
    assert list(Path("elsewhere").rglob("*.jsonl"))
    assert not any(outside.iterdir())


@pytest.mark.parametrize(
    ("error", "advice"),
    [
        (NotRegular("file", "a folder"), "Remove it, or put a regular file there."),
        (PermissionError(13, "Permission denied"), "Run rarms as its owner, or mend its rights."),
        (OSError(28, "No space left on device"), "Make room."),
    ],
)
def test_the_advice_fits_what_is_in_the_way(error: OSError, advice: str) -> None:
    assert advice_on(error, "Make room.") == advice
