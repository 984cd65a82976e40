"""Any content of a file that rarms reads, and anything in its place: a finding, never a bug of ours.

Documents are changed in one place and sealed again, so that no checksum stands in the way of what is tested.
"""

import copy
import hashlib
import json
import os
import re
import signal
import socket
from collections.abc import Callable, Iterator
from contextlib import chdir, contextmanager
from dataclasses import replace
from pathlib import Path
from typing import Any

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from rarms_iac.manifest.text.reading import read_text
from rarms_iac.views.finding_forms import OutputFormat
from tests.effort import LONG, examples
from tests.files import copy_files
from tests.fluid import without_scheduler
from tests.robots import CELL
from tests.unit.cli.running import Ran, rarms
from tests.unit.manifest.examples import EVERYTHING

OVERLAY = "application: { description: laid over }\ncomponents: { vision: { criticality: 31, memory: 512 MiB } }\n"

MEASURED = "measurements/onboard"
HOST = ".rarms/hosts/onboard.json"
JOURNAL = ".rarms/hosts/onboard.journal.jsonl"
DATA_LOG = f"{MEASURED}/paths/busy-loop.jsonl"
COMPOUND_LOG = f"{MEASURED}/paths+video/busy-loop.jsonl"
CONFIGURATION_LOG = f"{MEASURED}/paths.configuration.jsonl"
TUNING_LOG = f"{MEASURED}/tuning.jsonl"
PLAN, SNAPSHOT = "plan.json", "snapshot.json"
EVERYTHING_FILE = "everything.yaml"

PROOF: list[list[str]] = [["prove", "--load-host"]] if LONG else []
"""A proof takes seconds where what it reads is not a fault: the usual run has it for the host alone."""

READERS: dict[str, list[list[str]]] = {
    "rarms.yaml": [
        *(["validate", "--output", form] for form in OutputFormat),
        *([command] for command in ("plan", "fmt", "measure", "status", "graph", "explain", "doctor", "tune")),
        *PROOF,
        ["plan", "--output", "markdown"],
        ["report", "--out", "report.html"],
    ],
    EVERYTHING_FILE: [["validate", EVERYTHING_FILE, "--output", form] for form in OutputFormat],
    "overlay.yaml": [
        *(["validate", "--overlay", "overlay.yaml", "--output", form] for form in OutputFormat),
        ["plan", "--overlay", "overlay.yaml"],
        ["report", "--overlay", "overlay.yaml", "--out", "report.html"],
    ],
    HOST: [
        ["plan"],
        ["apply", PLAN],
        ["drift"],
        ["undo", "--auto-approve"],
        ["snapshot", "--out", "new.json"],
        ["prove", "--load-host"],
        ["measure", "vision"],
        ["doctor"],
        ["destroy", "--auto-approve"],
    ],
    JOURNAL: [
        ["plan"],
        ["apply", "--auto-approve"],
        ["apply", PLAN],
        ["drift"],
        ["undo", "--auto-approve"],
        ["history"],
        ["status"],
    ],
    DATA_LOG: [
        ["plan"],
        ["explain", "paths"],
        ["report", "--out", "report.html"],
        ["export", "table.csv"],
        ["export", "samples.csv", "--samples"],
        ["export", "table.xlsx"],
        ["measure"],
        ["select", "paths", "--at", "70 ms"],
        ["tune"],
        ["apply", "--auto-approve"],
        ["graph", "--candidates"],
    ],
    COMPOUND_LOG: [
        ["plan"],
        ["explain", "paths"],
        ["report", "--out", "report.html"],
        ["tune"],
        *PROOF,
    ],
    CONFIGURATION_LOG: [["plan"], ["explain", "paths"], *PROOF, ["report", "--out", "report.html"]],
    TUNING_LOG: [["tune"], ["report", "--out", "report.html"], ["explain", "paths"]],
    PLAN: [["show", PLAN], ["show", PLAN, "--script"], ["apply", PLAN], ["show", PLAN, "--json"]],
    SNAPSHOT: [["plan", "--snapshot", f"onboard={SNAPSHOT}"], ["plan", "--snapshot", SNAPSHOT, "--json"]],
}
"""The commands that read each file."""


SECONDS = 600  # what hangs does so for ever: this need not be near what a command takes
LINES = ("length", "checksum")
REMOVE = object()
HOSTILE_TEXT = "é\u202e\x1b[31m\x9b\r::error::x\n::error::x<script>hostile"
PRINTABLE_TEXT = "\n::error::x<script>hostile"
ODD_VALUES: list[Any] = [
    *(REMOVE, None, True, 0, -1, -0.0, 1.5, 1e308, -1e308, 1e-320, 10**30, 10**400, 2**63),
    *("", "gone", "x" * 3000, "1/3", "0/1", "-1/3", "9" * 40, "NaN", "2026-99-99", "../../x", "\x00", "\ud800"),
    *(
        HOSTILE_TEXT,
        PRINTABLE_TEXT,
        {HOSTILE_TEXT: 1},
        {PRINTABLE_TEXT: PRINTABLE_TEXT},
        [],
        {},
        json.loads("[" * 400 + "]" * 400),
    ),
]


def make_cell(folder: Path) -> Path:
    """Make the files of `READERS` in a new folder."""
    folder.mkdir()
    soon = CELL.replace("busy-loop }", "busy-loop, measuring: { setting: 25 s, proof: 1 s } }")
    (folder / "rarms.yaml").write_text(soon, encoding="utf-8", newline="\n")
    (folder / EVERYTHING_FILE).write_text(EVERYTHING, encoding="utf-8", newline="\n")
    (folder / "overlay.yaml").write_text(OVERLAY, encoding="utf-8", newline="\n")
    with chdir(folder):
        for words in (
            ["measure", "--samples", "60"],
            ["tune", "--samples", "60"],
            ["plan", "--out", PLAN],
            ["apply", PLAN],
            ["prove", "--load-host"],
            ["snapshot", "--out", SNAPSHOT],
        ):
            rarms(*words)
    assert not [file for file in READERS if not (folder / file).is_file()]
    return folder


@pytest.fixture(scope="module")
def cell(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Path]:
    with without_scheduler():
        yield make_cell(tmp_path_factory.mktemp("cell") / "files")


def paths_in(value: Any) -> Iterator[tuple[Any, ...]]:
    """The way to every value of a document; of a long array to its first."""
    if isinstance(value, dict | list):
        for key in list(value) if isinstance(value, dict) else range(min(len(value), 6)):
            yield (key,)
            yield from ((key, *rest) for rest in paths_in(value[key]))


def changed(document: Any, path: tuple[Any, ...], new: Any) -> Any:
    """The document with one value replaced, or removed."""
    document = copy.copy(document)
    if len(path) > 1:
        document[path[0]] = changed(document[path[0]], path[1:], new)
    elif new is REMOVE:
        del document[path[0]]
    else:
        document[path[0]] = new
    return document


def damage_line(file: Path, number: int, draw: Callable[[list[tuple[Any, ...]]], tuple[Any, ...]], new: Any) -> None:
    """Change a record and give it the checksum of its new text."""
    lines = file.read_bytes().splitlines(keepends=True)
    at = number % len(lines)
    record = {key: value for key, value in json.loads(lines[at]).items() if key not in LINES}
    text = json.dumps(changed(record, draw(list(paths_in(record))), new), separators=(",", ":")).encode()
    checksum = hashlib.sha256(text).hexdigest().encode()
    lines[at] = b'%s,"length":%d,"checksum":"%s"}\n' % (text[:-1], len(text), checksum)
    file.write_bytes(b"".join(lines))


def damage_document(file: Path, draw: Callable[[list[tuple[Any, ...]]], tuple[Any, ...]], new: Any) -> None:
    document = json.loads(file.read_bytes())
    file.write_text(json.dumps(changed(document, draw(list(paths_in(document))), new)), encoding="utf-8")


def damage_manifest(file: Path, draw: Callable[[list[tuple[Any, ...]]], tuple[Any, ...]], new: Any) -> None:
    """Change a manifest, and write it as JSON, which is YAML, too."""
    document = read_manifest(file)
    file.write_text(json.dumps(changed(document, draw(list(paths_in(document))), new), indent=1), encoding="utf-8")


def read_manifest(file: Path) -> Any:
    return read_text(file.read_bytes(), file.name, ".").value


def damage(
    folder: Path, name: str, number: int, draw: Callable[[list[tuple[Any, ...]]], tuple[Any, ...]], new: Any
) -> None:
    """Change one value of a file of `READERS`; of a log a value of this record."""
    file = folder / name
    if name.endswith(".jsonl") or name == HOST:
        damage_line(file, number, draw, new)
    elif name.endswith(".yaml"):
        damage_manifest(file, draw, new)
    else:
        damage_document(file, draw, new)


@contextmanager
def in_time() -> Iterator[None]:
    """Fail what hangs, where the system has alarms."""

    def fail(*_: object) -> None:
        raise AssertionError(f"it did not end within {SECONDS} s")

    if not hasattr(signal, "SIGALRM"):
        yield
        return
    before = signal.signal(signal.SIGALRM, fail)
    signal.alarm(SECONDS)
    try:
        yield
    finally:
        signal.alarm(0)
        signal.signal(signal.SIGALRM, before)


def check(answer: Ran) -> None:
    """It is not a bug of ours, and nothing that was read reaches the terminal as it is."""
    text = answer.out + answer.err
    assert "RARMS199" not in text
    assert "Traceback" not in text
    assert not RAW & set(text)
    assert not re.search(r"[\r\n]\s*::error::x", f"\n{text}")


RAW = set("\x1b\x9b\u202e")
"""Signs that change what a terminal shows."""


@settings(max_examples=examples(60))
@given(data=st.data(), file=st.sampled_from(sorted(READERS)), new=st.sampled_from(ODD_VALUES))
def test_value_that_was_never_written_is_finding(
    cell: Path, tmp_path_factory: pytest.TempPathFactory, data: st.DataObject, file: str, new: Any
) -> None:
    folder = tmp_path_factory.mktemp("damaged") / "files"
    copy_files(cell, folder)

    def draw(paths: list[tuple[Any, ...]]) -> tuple[Any, ...]:
        return data.draw(st.sampled_from(paths))

    try:
        damage(folder, file, data.draw(st.integers(0, 20)), draw, new)
    except (ValueError, TypeError):  # no seal can be made of it: the reader need not get further than we did
        return
    words = data.draw(st.sampled_from(READERS[file]))
    with chdir(folder), in_time():
        check(rarms(*words))


def text_fields(file: Path) -> dict[tuple[Any, ...], tuple[int, tuple[Any, ...]]]:
    """Every field of a document that is text, once: its shape, with the record and the way to it."""
    if file.suffix == ".yaml":
        documents = [read_manifest(file)]
    else:
        texts = [file.read_text(encoding="utf-8")]
        documents = [json.loads(text) for text in (texts[0].splitlines() if file.suffix == ".jsonl" else texts)]
    found: dict[tuple[Any, ...], tuple[int, tuple[Any, ...]]] = {}
    for number, document in enumerate(documents):
        for path in paths_in(document):
            value = document
            for key in path:
                value = value[key]
            if isinstance(value, str) and path[-1] not in LINES:
                shape = (document.get("kind"), *("each" if isinstance(key, int) else key for key in path))
                found.setdefault(shape, (number, path))
    return found


TEXTS = [HOSTILE_TEXT, PRINTABLE_TEXT, {PRINTABLE_TEXT: PRINTABLE_TEXT}]
"""A manifest with the first is read no further than to its signs; other documents have them escaped."""


@pytest.mark.parametrize(
    ("file", "new"),
    [(file, new) for file in sorted(READERS) for new in (TEXTS if LONG or file.endswith(".yaml") else TEXTS[:1])],
)
def test_no_text_of_document_reaches_reader_raw(cell: Path, tmp_path: Path, file: str, new: Any) -> None:
    """Every command that reads the document in the long run, in the usual one another for each field."""
    fields = text_fields(cell / file)
    for number, (record, path) in enumerate(fields.values()):
        commands = READERS[file]
        for words in commands if LONG else commands[number % len(commands) :][:1]:
            folder = tmp_path / str(number) / str(commands.index(words))
            copy_files(cell, folder)
            damage(folder, file, record, lambda _, path=path: path, new)  # type: ignore[misc]
            with chdir(folder), in_time():
                answer = rarms(*words, at_a_terminal=number % 2 == 1)
            plain = replace(answer, err=re.sub("\x1b\\[[0-9;?]*[a-zA-Z]", "", answer.err))
            check_shown(plain, words, folder)
    assert fields


def check_shown(answer: Ran, words: list[str], folder: Path) -> None:
    """Neither what a command wrote nor its page holds a hostile text as it is."""
    check(answer)
    page = folder / "report.html"
    shown = page.read_text(encoding="utf-8") if page.exists() else ""
    assert not RAW & set(shown)
    if {"markdown", "junit"} & set(words):
        shown += re.sub(r"`[^`]*`", "", answer.out)  # within code nothing is HTML
    assert "<script>hostile" not in shown


IMPOSSIBLE: list[tuple[str, int, tuple[Any, ...], Any, list[str]]] = [
    ("measurements/onboard/tuning.jsonl", 0, ("trail", 1, "components"), [], ["report", "--out", "report.html"]),
    ("measurements/onboard/paths.configuration.jsonl", -1, ("indexes", 0, "index"), "mean", ["report"]),
    ("measurements/onboard/paths.configuration.jsonl", -1, ("indexes", 0, "index"), "mean", ["prove", "--load-host"]),
]
"""Values of the right type that no rarms writes: a file, its record, the field, the value, a command."""


@pytest.mark.parametrize(("file", "record", "path", "new", "words"), IMPOSSIBLE)
def test_value_that_no_rarms_writes_makes_log_unreadable(
    cell: Path, tmp_path: Path, file: str, record: int, path: tuple[Any, ...], new: Any, words: list[str]
) -> None:
    folder = tmp_path / "files"
    copy_files(cell, folder)
    damage(folder, file, record, lambda _: path, new)

    with chdir(folder), in_time():
        answer = rarms(*words)

    assert "Traceback" not in answer.err
    assert Path(file).name in answer.err
    assert "RARMS199" not in answer.err
    assert "The proof" not in answer.err


def make_pipe(path: Path) -> None:
    os.mkfifo(path)


def make_folder(path: Path) -> None:
    path.mkdir()


def link_to_an_endless_device(path: Path) -> None:
    path.symlink_to("/dev/zero")


def link_to_itself(path: Path) -> None:
    path.symlink_to(path.name)


def link_to_a_pipe(path: Path) -> None:
    make_pipe(path.with_name("pipe"))
    path.symlink_to("pipe")


def empty_file(path: Path) -> None:
    path.write_bytes(b"")


def huge_file(path: Path) -> None:
    path.touch()
    os.truncate(path, 2**36)  # it takes no room on the disk


def link_to_nothing(path: Path) -> None:
    path.symlink_to("nothing")


def make_socket(path: Path) -> None:
    with chdir(path.parent), socket.socket(socket.AF_UNIX) as bound:  # from there, as its name must be short
        bound.bind(path.name)


IRREGULAR_FILES = [
    *(make_pipe, make_folder, make_socket, huge_file, empty_file),
    *(link_to_an_endless_device, link_to_itself, link_to_a_pipe, link_to_nothing),
]
LOCKS = {
    ".rarms/hosts/onboard.lock": [["apply", "--auto-approve"], ["plan"]],
    ".rarms/locks/configuration.lock": [["select", "paths", "--at", "70 ms"]],
    ".rarms/locks/onboard/vision/busy-loop.jsonl.lock": [["measure", "vision", "--samples", "70"]],
    ".rarms/.gitignore": [["measure", "vision", "--samples", "70"]],
}


@pytest.mark.needs("posix")
@pytest.mark.parametrize("file", sorted(READERS | LOCKS))
def test_what_is_no_regular_file_is_a_finding(cell: Path, tmp_path: Path, file: str) -> None:
    commands = (READERS | LOCKS)[file]
    for number, place in enumerate(IRREGULAR_FILES):
        folder = tmp_path / str(number)
        copy_files(cell, folder)
        (folder / file).unlink(missing_ok=True)
        place(folder / file)
        with chdir(folder), in_time():
            check(rarms(*commands[number % len(commands)]))


@pytest.mark.needs("posix")
@pytest.mark.parametrize("file", sorted(READERS | LOCKS))
def test_nothing_is_written_through_a_link(cell: Path, tmp_path: Path, file: str) -> None:
    for number, words in enumerate((READERS | LOCKS)[file]):
        folder, victim = tmp_path / str(number), tmp_path / f"victim-{number}"
        copy_files(cell, folder)
        content = (folder / file).read_bytes()
        victim.write_bytes(content)
        (folder / file).unlink(missing_ok=True)
        (folder / file).symlink_to(victim)
        with chdir(folder), in_time():
            check(rarms(*words))
        assert victim.read_bytes() == content, words
