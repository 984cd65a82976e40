"""One holder at a time, in threads and processes, and none after its death."""

import errno
import hashlib
import io
import json
import os
import subprocess
import sys
import threading
import time
from collections.abc import Callable
from contextlib import suppress
from pathlib import Path

import pytest

from rarms_iac.storage import disk
from rarms_iac.storage.codec import Json, NotDecodable
from rarms_iac.storage.disk import NotRegular, make_folder_for
from rarms_iac.storage.json_text import parse_json
from rarms_iac.storage.reading import TooLarge, open_regular, read_file, read_input
from rarms_iac.storage.records import Damaged, Record, first_in, iterate_log, last_in, records_in, sealed_line
from rarms_iac.storage.shipped import NotShipped, shipped
from rarms_iac.storage.writing import (
    Locked,
    append,
    hold,
    read_holder,
    read_owner,
    remove_leftovers,
    remove_leftovers_of_ended,
    replace,
)
from tests.crashing import Crash, CrashingDisk, When
from tests.needs import require

HOLDER = """
import sys, time
from pathlib import Path
from rarms_iac.storage.writing import hold
with hold(Path(sys.argv[1]), "ann@lab, process 7, since noon, rarms apply"):
    print("held", flush=True)
    time.sleep(60)
"""


def start_holder(path: Path) -> "subprocess.Popen[str]":
    process = subprocess.Popen([sys.executable, "-c", HOLDER, str(path)], stdout=subprocess.PIPE, text=True)
    assert process.stdout is not None
    assert process.stdout.readline().strip() == "held"
    return process


def kill(process: "subprocess.Popen[str]") -> None:
    process.kill()
    process.communicate()


def test_file_that_is_read_can_be_removed(tmp_path: Path) -> None:
    """Windows lets nobody remove or replace what a reader has open who does not say so."""
    path, fresh = tmp_path / "journal", tmp_path / "fresh"
    path.write_bytes(b"one")
    fresh.write_bytes(b"two")

    with open_regular(path) as file:
        path.rename(tmp_path / "old")
        fresh.rename(path)
        (tmp_path / "old").unlink()
        text = file.read()

    assert (text, path.read_bytes()) == (b"one", b"two")


@pytest.mark.parametrize("name", ["a\0b", "missing"])
def test_name_that_no_file_has_is_refused(name: str, tmp_path: Path) -> None:
    with pytest.raises((ValueError, FileNotFoundError)):
        read_file(tmp_path / name, 100)


def test_second_holder_is_told_who_first_is(tmp_path: Path) -> None:
    path = tmp_path / "onboard.lock"
    with hold(path, "ann@lab"):
        with pytest.raises(Locked) as locked, hold(path, "bob@lab"):
            pytest.fail("two hold the lock")
        assert locked.value.owner == "ann@lab"
        assert read_owner(path) == read_holder(path) == "ann@lab"

    assert read_owner(path) == ""
    with hold(path, "bob@lab"):
        assert read_owner(path) == "bob@lab"


def test_death_frees_the_lock(tmp_path: Path) -> None:
    path = tmp_path / "onboard.lock"
    process = start_holder(path)
    try:
        with pytest.raises(Locked) as locked, hold(path, "bob@lab", timeout_ms=50):
            pytest.fail("two hold the lock")
    finally:
        kill(process)

    assert locked.value.owner == "ann@lab, process 7, since noon, rarms apply"
    assert read_owner(path) == locked.value.owner
    assert read_holder(path) == "", "its name is there, and the process is not"
    with hold(path, "bob@lab", timeout_ms=2000):
        assert read_owner(path) == "bob@lab"


def test_waiting_ends_when_the_lock_is_given_back(tmp_path: Path) -> None:
    path = tmp_path / "onboard.lock"
    order: list[str] = []

    def wait() -> None:
        with hold(path, "second", timeout_ms=5000):
            order.append("second")

    with hold(path, "first"):
        thread = threading.Thread(target=wait)
        thread.start()
        time.sleep(0.1)
        order.append("first")
    thread.join()

    assert order == ["first", "second"]


def test_the_lock_is_given_back_after_an_error(tmp_path: Path) -> None:
    path = tmp_path / "onboard.lock"
    with pytest.raises(RuntimeError), hold(path, "first"):
        raise RuntimeError

    with hold(path, "second"):
        assert read_owner(path) == "second"


def test_file_is_read_to_its_limit(tmp_path: Path) -> None:
    file = tmp_path / "file"
    file.write_bytes(b"12345")

    assert read_file(file, 5) == b"12345"
    with pytest.raises(TooLarge, match="more than 4 bytes"):
        read_file(file, 4)


def test_standard_input_is_read_to_its_limit(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("sys.stdin", io.TextIOWrapper(io.BytesIO(b"12345678")))

    assert read_input("-", 4096) == b"12345678"
    monkeypatch.setattr("sys.stdin", io.TextIOWrapper(io.BytesIO(b"12345678")))
    with pytest.raises(TooLarge):
        read_input("-", 7)


@pytest.mark.needs("linux")
@pytest.mark.parametrize("name", ["/proc/kmsg", "/proc/self/environ", "/sys/kernel/mm/transparent_hugepage/enabled"])
def test_kernel_file_is_no_regular_file(name: str, tmp_path: Path) -> None:
    link = tmp_path / "link"
    link.symlink_to(name)

    for path in (Path(name), link):
        with pytest.raises(NotRegular, match="a file of the kernel"):
            read_file(path, 100)


def test_a_link_counts_as_what_it_leads_to(tmp_path: Path) -> None:
    require("posix")
    (tmp_path / "file").write_bytes(b"text")
    (tmp_path / "link").symlink_to("file")
    (tmp_path / "endless").symlink_to("/dev/zero")

    assert read_file(tmp_path / "link", 10) == b"text"
    with pytest.raises(NotRegular, match="device"):
        read_file(tmp_path / "endless", 10)


@pytest.mark.parametrize("number", ["1e999", "-1E+400", "1" * 400 + ".0"])
def test_number_that_no_float_can_hold_is_refused(number: str) -> None:
    with pytest.raises(NotDecodable, match="too large"):
        parse_json(f'{{"response_ms": [1.5, {number}]}}')


def test_text_that_looks_like_huge_number_is_text() -> None:
    assert parse_json('{"id": "3e9995", "small": 1e-999}') == {"id": "3e9995", "small": 0.0}


def test_the_findings_pages_are_found() -> None:
    assert shipped("docs/findings").is_dir()


def test_what_is_missing_is_named() -> None:
    with pytest.raises(NotShipped, match="docs/no-such-folder of rarms is missing"):
        shipped("docs/no-such-folder")


def records_of(journal: Path) -> tuple[dict[str, Json], ...]:
    return records_in(journal.read_bytes(), journal) if journal.exists() else ()


def test_replace_leaves_only_the_file(tmp_path: Path) -> None:
    replace(tmp_path / "state.json", b"one")
    replace(tmp_path / "state.json", b"two")

    assert {path.name: path.read_bytes() for path in tmp_path.iterdir()} == {"state.json": b"two"}


def test_replace_flushes_content_before_name(tmp_path: Path) -> None:
    counting = CrashingDisk(0)
    with disk.use(counting):
        replace(tmp_path / "state.json", b"one")

    assert [effect.split()[0] for effect in counting.effects] == ["write", "flush", "rename", "flush_folder"]


@pytest.mark.parametrize("when", When)
@pytest.mark.parametrize("at", [1, 2, 3, 4])
def test_crash_while_replacing_leaves_old_or_new_content(tmp_path: Path, at: int, when: When) -> None:
    path = tmp_path / "state.json"
    replace(path, b"old content")

    with disk.use(CrashingDisk(at, when)), pytest.raises(Crash):
        replace(path, b"new content")

    assert path.read_bytes() == (b"new content" if (at, when) == (3, When.AFTER) or at == 4 else b"old content")
    remove_leftovers(path)
    assert [file.name for file in tmp_path.iterdir()] == ["state.json"]


def test_leftovers_go_and_current_writes_stay(tmp_path: Path) -> None:
    ended = subprocess.Popen([sys.executable, "-c", ""])
    ended.wait()
    path = tmp_path / "rarms[7].yaml"
    names = {number: f".{path.name}.{number}-1.new" for number in (ended.pid, os.getpid())}
    for name in names.values():
        (tmp_path / name).touch()

    remove_leftovers_of_ended(path)

    assert [file.name for file in tmp_path.iterdir()] == [names[os.getpid()]]


def test_open_reader_delays_a_replace(tmp_path: Path) -> None:
    path = tmp_path / "state.json"
    replace(path, b"old")
    with path.open("rb") as reader:
        closing = threading.Timer(0.2, reader.close)  # on Windows an open file cannot be replaced
        closing.start()
        replace(path, b"new")
        closing.join()

    assert path.read_bytes() == b"new"


def test_replace_that_fails_leaves_nothing_beside_file(tmp_path: Path) -> None:
    class FullDisk(disk.FileEffects):
        def rename(self, source: Path, target: Path) -> None:
            raise OSError(errno.ENOSPC, "no space left", str(target))

    target = tmp_path / "state.json"
    replace(target, b"old")

    with disk.use(FullDisk()), pytest.raises(OSError, match="no space left"):
        replace(target, b"new")

    assert {path.name: path.read_bytes() for path in tmp_path.iterdir()} == {"state.json": b"old"}


def test_folder_in_the_way_is_not_replaced(tmp_path: Path) -> None:
    (tmp_path / "state.json" / "kept").mkdir(parents=True)

    with pytest.raises(NotRegular, match="a folder"):
        replace(tmp_path / "state.json", b"new")

    assert [path.name for path in tmp_path.rglob("*")] == ["state.json", "kept"]


@pytest.mark.parametrize("torn", [b"", b'{"b":'], ids=["whole", "torn"])
def test_appended_record_is_on_the_disk(tmp_path: Path, monkeypatch: pytest.MonkeyPatch, torn: bytes) -> None:
    journal = tmp_path / "journal.jsonl"
    journal.write_bytes(sealed_line({"a": 1}) + torn)
    flushed: list[int] = []
    monkeypatch.setattr("os.fsync", lambda descriptor: flushed.append(os.fstat(descriptor).st_size))

    with disk.use(disk.FileEffects()):
        append(journal, {"b": 2})

    assert flushed == [journal.stat().st_size] == [len(sealed_line({"a": 1}) + sealed_line({"b": 2}))]


def test_records_come_back_in_order(tmp_path: Path) -> None:
    journal = tmp_path / "journal.jsonl"
    records: list[Record] = [
        {"kind": "begun", "number": 1},
        {"kind": "done", "text": "ä\n\u2028"},
        {"kind": "done", "n": [1.5]},
    ]
    for record in records:
        append(journal, record)

    assert records_of(journal) == tuple(records)
    assert first_in(journal.read_bytes(), journal) == records[0]
    assert last_in(journal.read_bytes(), journal) == records[-1]
    assert len(journal.read_bytes().splitlines()) == 3


def test_length_and_checksum_are_fields_of_the_object() -> None:
    line = sealed_line({"a": 1})

    assert json.loads(line)["length"] == len('{"a":1}')
    assert set(json.loads(line)) == {"a", "length", "checksum"}


def test_no_file_has_no_records(tmp_path: Path) -> None:
    assert tuple(iterate_log(tmp_path / "journal.jsonl")) == ()
    assert last_in(b"", tmp_path) is None


def test_windows_line_ends_do_no_harm(tmp_path: Path) -> None:
    journal = tmp_path / "journal.jsonl"
    journal.write_bytes((sealed_line({"a": 1}) + sealed_line({"a": 2})).replace(b"\n", b"\r\n"))

    append(journal, {"a": 3})

    assert records_of(journal) == ({"a": 1}, {"a": 2}, {"a": 3})


@pytest.mark.parametrize("padding", [0, 5000, 20_000])
def test_torn_last_record_is_replaced(tmp_path: Path, padding: int) -> None:
    journal = tmp_path / "journal.jsonl"
    append(journal, {"a": "x" * padding})
    whole = journal.read_bytes()
    append(journal, {"b": "y" * padding})
    both = journal.read_bytes()
    step = max(1, padding // 7)

    for size in [*range(len(whole) + 1, len(both), step), len(both) - 1]:
        journal.write_bytes(both[:size])
        assert records_of(journal) == ({"a": "x" * padding},)
        assert last_in(both[:size], journal) is None
        append(journal, {"c": 3})
        assert records_of(journal) == ({"a": "x" * padding}, {"c": 3})


def test_zeroed_last_record_is_dropped(tmp_path: Path) -> None:
    journal = tmp_path / "journal.jsonl"
    journal.write_bytes(sealed_line({"a": 1}) + b"\0" * 40 + b"\n")

    append(journal, {"b": 2})

    assert records_of(journal) == ({"a": 1}, {"b": 2})


@pytest.mark.parametrize("at", [3, 20, -5])
def test_a_damaged_earlier_record_is_an_error(tmp_path: Path, at: int) -> None:
    journal = tmp_path / "journal.jsonl"
    first = bytearray(sealed_line({"a": "text"}))
    first[at] ^= 1
    journal.write_bytes(bytes(first) + sealed_line({"b": 2}))

    with pytest.raises(Damaged) as damaged:
        records_of(journal)
    assert damaged.value.line == 1
    with pytest.raises(Damaged):
        first_in(journal.read_bytes(), journal)


DAMAGED: list[Callable[[bytes, bytes], bytes]] = [
    lambda first, last: b"",
    lambda first, last: b"\0" * len(first),
    lambda first, last: b"\0" * len(first) + b"\n" + last,
    lambda first, last: first[:-9],
    lambda first, last: first.replace(b"\n", b"\r") + last.replace(b"\n", b"\r"),
    lambda first, last: first + last.replace(b"last", b"lost"),
    lambda first, last: first + b"\n" + last,
    lambda first, last: first + last[:-5] + b"\n" + last,
]


@pytest.mark.parametrize("damage", DAMAGED)
def test_impossible_damage_is_refused(tmp_path: Path, damage: Callable[[bytes, bytes], bytes]) -> None:
    journal = tmp_path / "journal.jsonl"
    journal.write_bytes(data := damage(sealed_line({"a": "first"}), sealed_line({"b": "last"})))

    for use in (lambda: records_of(journal), lambda: append(journal, {"c": 3})):
        with pytest.raises(Damaged):
            use()
    assert journal.read_bytes() == data


def test_log_damaged_later_is_read_again(tmp_path: Path) -> None:
    journal = tmp_path / "journal.jsonl"
    for number in range(3):
        append(journal, {"number": number})
    journal.write_bytes(journal.read_bytes().replace(b'"number":1', b'"number":7'))

    with pytest.raises(Damaged) as damaged:
        append(journal, {"number": 3})

    assert damaged.value.line == 2


def test_sealed_record_that_is_not_ascii_is_damaged() -> None:
    text = '{"name":"\xe9"}'.encode()
    seal = b'%s,"length":%d,"checksum":"%s"}\n'

    with pytest.raises(Damaged, match="not ASCII"):
        records_in(seal % (text[:-1], len(text), hashlib.sha256(text).hexdigest().encode()), Path("journal.jsonl"))


@pytest.mark.parametrize("record", [{}, {"length": 1}, {"checksum": ""}])
def test_fields_that_the_line_needs_are_refused(record: dict[str, int | str]) -> None:
    with pytest.raises(ValueError, match="at least one field"):
        sealed_line(dict(record))


@pytest.mark.parametrize("when", When)
@pytest.mark.parametrize("at", [1, 2, 3, 4])
def test_crash_while_first_record_is_added_tears_nothing(tmp_path: Path, at: int, when: When) -> None:
    journal = tmp_path / "journal.jsonl"
    with disk.use(CrashingDisk(at, when)), pytest.raises(Crash):
        append(journal, {"a": 1})
    survived = records_of(journal)

    append(journal, {"b": 2})

    assert survived in ((), ({"a": 1},))
    assert records_of(journal) == (*survived, {"b": 2})


def test_the_private_folder_is_kept_out_of_git(tmp_path: Path) -> None:
    make_folder_for(tmp_path / ".rarms" / "hosts" / "onboard.json")
    make_folder_for(tmp_path / "elsewhere" / "onboard.json")

    assert (tmp_path / ".rarms" / ".gitignore").read_bytes() == b"*\n"
    assert list((tmp_path / "elsewhere").iterdir()) == []


def test_killed_writer_leaves_no_other_file(tmp_path: Path) -> None:
    for at in range(1, 8):
        folder = tmp_path / str(at) / ".rarms"
        folder.parent.mkdir()
        with disk.use(CrashingDisk(at, When.HALF)), suppress(Crash):
            make_folder_for(folder / "hosts" / "onboard.json")
        make_folder_for(folder / "hosts" / "onboard.json")

        assert [path.name for path in folder.iterdir() if path.is_file()] == [".gitignore"]
        assert (folder / ".gitignore").read_bytes().startswith(b"*")
