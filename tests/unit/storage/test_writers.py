"""The two writers: whole or not at all, and torn records."""

import hashlib
import json
import os
import subprocess
import sys
import threading
from collections.abc import Callable
from contextlib import suppress
from pathlib import Path

import pytest

from rarms_iac.storage import disk
from rarms_iac.storage.append import Damaged, Record, append, first_in, iterate_log, last_in, records_in, sealed_line
from rarms_iac.storage.codec import Json
from rarms_iac.storage.disk import make_folder_for
from rarms_iac.storage.replace import remove_leftovers, remove_leftovers_of_ended, replace
from tests.crashing import Crash, CrashingDisk, When


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
    target = tmp_path / "state.json"
    (target / "in the way").mkdir(parents=True)  # a folder cannot be replaced by a file

    with pytest.raises(OSError):  # noqa: PT011  (which OSError it is, the system decides)
        replace(target, b"new")

    assert [path.name for path in tmp_path.iterdir()] == ["state.json"]


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
