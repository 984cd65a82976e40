"""Files that `run.files` names: walked once, bounded, and large ones not read again."""

import os
import re
import time
from pathlib import Path

import pytest

from rarms_iac.storage.datalog import named_files
from rarms_iac.storage.datalog.named_files import LARGE, YOUNG_NS, Files, cache_folder
from tests.builders_measured import a_subject
from tests.unit.storage.datalog.test_identity import running


@pytest.fixture(autouse=True)
def home(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path / "cache"))
    folder = tmp_path / "checkout"
    folder.mkdir()
    return folder


def named(folder: Path, *patterns: str) -> list[str]:
    return list(Files(folder).of(running(("x",), *patterns)))


def place(folder: Path, *names: str) -> None:
    for name in names:
        (folder / name).parent.mkdir(parents=True, exist_ok=True)
        (folder / name).write_text(name, encoding="utf-8")


PATTERNS = {
    "*": ["top.py"],
    "**": ["a/b/c.py", "a/b/x", "a/one.py", "top.py"],
    "**/*.py": ["a/b/c.py", "a/one.py", "top.py"],
    "a/*.py": ["a/one.py"],
    "a/**": ["a/b/c.py", "a/b/x", "a/one.py"],
    "**/b/*": ["a/b/c.py", "a/b/x"],
    "a/**/**/x": ["a/b/x"],
    "[a-b]/on?.py": ["a/one.py"],
    "a/b/../one.py": ["a/one.py"],
    ".hidden/*": [".hidden/in.py"],
    "**/.rc": [".rc"],
    "a": [],
    "../checkout/top.py": ["top.py"],
    "../*": [],
    "nothing/*": [],
    "to-b/*": ["a/b/c.py", "a/b/x"],
}


@pytest.mark.needs("posix")
@pytest.mark.parametrize("pattern", PATTERNS)
def test_pattern_names_files_that_shell_would(home: Path, pattern: str) -> None:
    place(home, "top.py", "a/one.py", "a/b/c.py", "a/b/x", ".hidden/in.py", ".rc")
    (home / "to-b").symlink_to("a/b")

    assert named(home, pattern) == PATTERNS[pattern]


def test_many_folders_in_a_pattern_are_walked_once(home: Path) -> None:
    folder = home
    for _ in range(20):
        folder /= "d"
        place(folder, "x", "y")
    files = Files(home)

    found = files.of(running(("x",), "**/**/**/**/**/**/**/**/x", *["**/d/**/d/**/d/**/d/**/x"] * 10))

    assert len(found) == 20
    assert files.cut == ""


def test_first_names_count_and_it_is_said(home: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(named_files, "MOST_ENTRIES", 50)
    place(home, *(f"f{number:03}" for number in range(100)))
    files = Files(home)

    assert list(files.of(running(("x",), "*"))) == [f"f{number:03}" for number in range(49)]
    assert files.cut == "only the first 50 names were read"


def test_first_files_are_read_and_it_is_said(home: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(named_files, "MOST_FILES", 5)
    place(home, *(f"f{number}" for number in range(9)))
    files = Files(home)

    assert list(files.of(running(("x",), "*"))) == [f"f{number}" for number in range(5)]
    assert files.cut == "only the first 5 files were read"


def test_large_file_is_left_out_when_looking(home: Path) -> None:
    place(home, "small")
    (home / "huge").touch()
    os.truncate(home / "huge", 2**30)  # it takes no room on the disk

    assert named(home, "*") == ["small"]


def test_huge_file_counts_by_size_and_says_so(home: Path) -> None:
    place(home, "small")
    (home / "a-huge").touch()
    os.truncate(home / "a-huge", 2**33)  # it takes no room on the disk
    subject = running(("x",), "*")
    measured, compared = Files(home, most_bytes=None), Files(home)

    found = measured.of(subject)

    assert found["a-huge"] == f"size {2**33}"
    assert re.fullmatch("[0-9a-f]{16}", found["small"])
    assert compared.of(subject) == found
    assert measured.cut == compared.cut == "only the size of a-huge is compared, because its files have more than 2 GiB"
    os.truncate(home / "a-huge", 2**33 + 1)
    assert Files(home).of(subject) != found


@pytest.mark.needs("posix")
def test_huge_program_counts_by_size_and_says_so(home: Path, tmp_path: Path) -> None:
    program = tmp_path / "huge"
    program.touch(mode=0o700)
    os.truncate(program, 2**33)  # it takes no room on the disk
    files = Files(home, most_bytes=None)

    assert files.interpreters(running((str(program),))) == {str(program): f"size {2**33}"}
    assert files.cut == (
        f"only the size of {program} is compared, because the programs of the commands have more than 256 MiB"
    )


@pytest.mark.needs("posix")  # Windows keeps no time of a change of state
def test_large_file_is_read_once(home: Path) -> None:
    large, subject = home / "model.bin", running(("x",), "*")
    large.write_bytes(b"\0" * LARGE)
    old = time.time_ns() - 10 * YOUNG_NS
    os.utime(large, ns=(old, old))
    digests = Files(home, most_bytes=None).of(subject)

    assert (cache_folder() / "digests.json").is_file()
    assert Files(home, most_bytes=0).of(subject) == {}  # its state changed just now: the entry says nothing yet
    wait_until_old(large)
    Files(home, most_bytes=None).of(subject)
    assert Files(home, most_bytes=0).of(subject) == digests
    large.write_bytes(b"\1" * LARGE)
    assert Files(home, most_bytes=0).of(subject) == {}


def wait_until_old(file: Path) -> None:
    while time.time_ns() - file.stat().st_ctime_ns <= YOUNG_NS:
        time.sleep(0.05)


@pytest.mark.parametrize("content", [b"", b"[]", b"{", b'{"x": 1}', b"\xff", b"[" * 10_000])
def test_a_damaged_cache_says_nothing(home: Path, content: bytes) -> None:
    (home / "model.bin").write_bytes(b"\0" * LARGE)
    cache_folder().mkdir(parents=True)
    (cache_folder() / "digests.json").write_bytes(content)

    assert named(home, "*") == ["model.bin"]


def test_a_component_without_files_opens_nothing(home: Path) -> None:
    assert Files(home).of(a_subject()) == {}
    assert not cache_folder().exists()
