"""What a person reads keeps to a narrow terminal, whichever command says it."""

import os
from collections.abc import Iterator
from contextlib import chdir, contextmanager
from pathlib import Path

import pytest

from tests.fluid import without_scheduler
from tests.unit.cli.running import rarms
from tests.unit.measuring.test_measure import MANIFEST, write

COMMANDS = (
    ("validate",),
    ("measure",),
    ("plan",),
    ("drift",),
    ("explain", "vision"),
    ("explain", "vision", "--guide"),
    ("explain", "RARMS160"),
    ("report", "--text"),
    ("select", "vision", "--at", "1 ms"),
    ("prove", "--load-host"),
    ("apply",),
    ("tune",),
    ("plan", "--out", "the-plan-of-this-robot-and-of-no-other-one-in-the-hall.plan"),
    ("init", "a-folder-for-the-first-manifest-of-another-robot"),
    ("snapshot", "--script", "--out", "the-script-that-looks.ps1"),
    ("show", "--check", "the-script-that-looks.ps1"),
)


@contextmanager
def a_terminal_of(columns: int) -> Iterator[None]:
    """As a shell says it to what it starts."""
    before = os.environ.get("COLUMNS")
    os.environ["COLUMNS"] = str(columns)
    try:
        yield
    finally:
        if before is None:
            del os.environ["COLUMNS"]
        else:
            os.environ["COLUMNS"] = before


@pytest.fixture(scope="module")
def robot(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A measured robot, and a component that was not measured."""
    folder = tmp_path_factory.mktemp("robot")
    write(folder, MANIFEST)
    with chdir(folder), without_scheduler():
        assert rarms("measure", "--samples", "60").code == 0
    return folder


@pytest.mark.parametrize("columns", [60, 80])
@pytest.mark.parametrize("words", COMMANDS, ids=" ".join)
def test_no_line_of_words_is_wider_than_terminal(robot: Path, words: tuple[str, ...], columns: int) -> None:
    with chdir(robot), a_terminal_of(columns):
        ran = rarms(*words)

    # A command on a line of its own is not broken, so that it can be copied.
    told = [line for line in (*ran.lines, *ran.err.splitlines()) if not line.startswith("  powershell ")]
    assert [line for line in told if len(line) > columns and not is_one_word(line, columns)] == []
    assert told


def test_long_names_are_shown_in_80_columns(tmp_path: Path) -> None:
    names = [
        "obstacle-avoidance-of-the-front-left-wheel",
        "speech-recognition-of-english-and-finnish",
        "door-opening-and-closing-in-the-warehouse",
        "battery-supervision",
    ]
    extra = "task: RecognitionOfTheSpokenOrders"
    entries = "".join(
        f"  {name}: {{ criticality: 1, memory: 64 MiB, cpu: {{ reserve: 3 % }}, {extra} }}\n" for name in names
    )
    shared = f"partitions: {{ everything-that-is-not-critical: {{ components: [{', '.join(names[1:])}] }} }}\n"
    host = "hosts: { onboard-computer-of-the-first-robot: { logical_processors: 4, memory: 8 GiB } }\n"
    head = f"schema: rarms/v1\napplication: {{ name: robot }}\n{host}tasks: {{ RecognitionOfTheSpokenOrders: {{}} }}\n"
    Path(tmp_path, "rarms.yaml").write_text(f"{head}components:\n{entries}{shared}", encoding="utf-8")

    with chdir(tmp_path), a_terminal_of(80):
        texts = [rarms(*words).out for words in (("plan",), ("plan", "--verbose"), ("status",))]
        applied = rarms("apply", "--auto-approve")
        texts += [applied.err, *(rarms(*words).out for words in (("status",), ("stop", "--auto-approve")))]

    assert applied.code == 0
    for text in texts:
        assert [line for line in text.splitlines() if len(line) > 80 and not is_one_word(line, 80)] == []
    for text in (*texts[:2], texts[4]):
        assert [name for name in names if name not in text] == []


def is_one_word(line: str, columns: int) -> bool:
    """A path or a place: it is not broken, so that it can be copied."""
    return max(map(len, line.split())) > columns - 10
