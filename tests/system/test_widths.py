"""Every command on a real terminal of 80 and of 120 columns, and in a pipe: what is wrapped, and where."""

import json
import os
import re
import struct
import subprocess
import sys
from collections.abc import Iterator
from itertools import pairwise
from pathlib import Path

import pytest

from tests.files import copy_files
from tests.needs import CHECKOUT
from tests.robots import a_measured, a_robot_of

pytestmark = pytest.mark.needs("posix")

MANIFEST = a_robot_of(
    a_measured("avoidance", criticality=40, at_most="42 ms", until="samples: 30"),
    a_measured("speech-recognition", at_most="60 ms", until="samples: 30", simulation="work: 25 ms, varies: 2 %"),
    name="delivery",
    policy="interference: busy-loop, measuring: { setting: 10 s, proof: 2 s }",
)
"""Its components need more than the host has, until two of them share a partition."""

COMMANDS = (
    "status",
    "validate",
    "doctor",
    "measure --quick",
    "plan",
    "measure",
    "plan",
    "plan --output markdown",
    "graph --candidates",
    "tune",
    "plan -v",
    "plan --output markdown",
    "plan --out first.plan",
    "show first.plan",
    "apply first.plan --auto-approve",
    "status",
    "drift",
    "prove --load-host",
    "status",
    "doctor",
    "history",
    "explain avoidance",
    "explain avoidance --guide",
    "explain RARMS014",
    "report --text",
    "report",
    "export measured.csv",
    "graph",
    "measure speech-recognition --from 60% --to 100% --step 20% --stop-partitions",
    "select speech-recognition --at 90ms",
    "plan",
    "apply --auto-approve",
    "simulate change speech-recognition --off",
    "drift",
    "status",
    "plan",
    "apply --auto-approve",
    "stop avoidance --auto-approve",
    "status",
    "start --auto-approve",
    "undo --auto-approve",
    "fmt --check",
    "snapshot --out onboard.json",
    "run avoidance",
    "release speech-recognition --auto-approve",
    "destroy --auto-approve",
    "history",
    "status",
    "plan --host elsewhere",
    "explain nobody",
)
"""One after the other: what each shows follows from those before it."""

OWN_LINES = (
    "report --text",
    "graph",
    "plan --output markdown",
    "explain RARMS014",
    "select speech-recognition --at 90ms",
)
"""What these write has lines of its own: a plot, a picture, Markdown, the code of a page, and facts in a list."""

FOR_PROGRAMS = ("graph", "plan --output markdown")
"""A browser shows what these write."""

RUNS = """\
import json, sys
from rarms_iac.cli.main import main
for words in json.loads(sys.argv[1]):
    print("$", words, flush=True)
    main(words.split())
    sys.stdout.flush()
    sys.stderr.flush()
"""
"""Runs commands in one process, so that Python starts once."""

ESCAPES = re.compile(r"\x1b\[([0-9;?]*)([A-Za-z])|([\r\n])|([^\x1b\r\n])")


@pytest.fixture(scope="module")
def robot(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A folder with the manifest and what measuring and tuning need, so that each test's copy is quick."""
    folder = tmp_path_factory.mktemp("robot")
    (folder / "rarms.yaml").write_text(MANIFEST, encoding="utf-8", newline="\n")
    in_pipe(folder, "measure", "tune --dry-run")
    return folder


def environment() -> dict[str, str]:
    named = {name: value for name, value in os.environ.items() if name not in {"COLUMNS", "LINES", "RARMS_MANIFEST"}}
    return {**named, "TERM": "xterm", "NO_COLOR": "1", "PYTHONPATH": str(CHECKOUT)}


def command_line(*commands: str) -> list[str]:
    return [sys.executable, "-c", RUNS, json.dumps(commands)]


def at_terminal(folder: Path, columns: int, *commands: str) -> dict[str, list[str]]:
    """Run the commands on a terminal of so many columns; what stays on its screen, by command."""
    import fcntl
    import pty
    import termios

    master, slave = pty.openpty()
    fcntl.ioctl(slave, termios.TIOCSWINSZ, struct.pack("HHHH", 50, columns, 0, 0))
    process = subprocess.Popen(
        command_line(*commands),
        cwd=folder,
        env=environment(),
        stdin=subprocess.DEVNULL,
        stdout=slave,
        stderr=slave,
        start_new_session=True,
    )
    os.close(slave)
    written = b""
    while piece := _read(master):
        written += piece
    os.close(master)
    assert process.wait() == 0
    return by_command(screen(written.decode()))


def in_pipe(folder: Path, *commands: str) -> dict[str, list[str]]:
    """Run the commands in a pipe; what they write, by command."""
    ran = subprocess.run(
        command_line(*commands),
        cwd=folder,
        env=environment(),
        stdin=subprocess.DEVNULL,
        stdout=subprocess.PIPE,
        stderr=subprocess.STDOUT,
        encoding="utf-8",
        check=True,
    )
    assert "\x1b" not in ran.stdout
    return by_command(ran.stdout.splitlines())


def _read(master: int) -> bytes:
    try:
        return os.read(master, 65536)
    except OSError:  # Linux says so when the last writer is gone
        return b""


def screen(written: str) -> list[str]:
    """Return the lines that a terminal shows in the end, however wide they are."""
    lines: list[list[str]] = [[]]
    row = column = 0
    for number, letter, control, sign in (found.groups() for found in ESCAPES.finditer(written)):
        if control == "\r":
            column = 0
        elif control == "\n":
            row += 1
            lines += [[] for _ in range(row + 1 - len(lines))]
        elif letter == "A":
            row -= int(number or 1)
        elif letter == "K":
            lines[row] = [] if number == "2" else lines[row][:column]
        elif sign:
            line = lines[row]
            line += " " * (column - len(line))
            line[column : column + 1] = [sign]
            column += 1
    return ["".join(line).rstrip() for line in lines]


def by_command(lines: list[str]) -> dict[str, list[str]]:
    shown: dict[str, list[str]] = {}
    for line in lines:
        if line.startswith("$ "):
            shown[f"{len(shown)} {line[2:]}"] = []
        else:
            list(shown.values())[-1].append(line)
    return shown


def broken_early(lines: list[str], columns: int) -> Iterator[tuple[str, str]]:
    """Yield each line of a sentence that has room for the first word of the next line."""
    for line, following in pairwise(lines):
        words = following.split()
        is_sentence = "  " not in line.strip() and "  " not in following.strip() and len(line.split()) > 2
        goes_on = words and re.fullmatch(r"[a-z]+", words[0]) and re.search(r"[a-z0-9,]$", line)
        is_aligned = len(line) - len(line.lstrip()) == len(following) - len(following.lstrip())
        if is_sentence and is_aligned and goes_on and len(line) + 1 + len(words[0]) <= columns:
            yield line, following


def words_of(command: str) -> str:
    return command.split(" ", 1)[1]


@pytest.mark.parametrize("columns", [80, 120])
def test_output_fits_terminal_and_uses_it(robot: Path, tmp_path: Path, columns: int) -> None:
    shown = at_terminal(copy_files(robot, tmp_path), columns, *COMMANDS)

    assert len(shown) == len(COMMANDS)
    for command, lines in shown.items():
        if words_of(command) not in FOR_PROGRAMS:
            assert [line for line in lines if len(line) > columns] == [], command
        if words_of(command) not in OWN_LINES:
            assert list(broken_early(lines, columns)) == [], command
    assert max(len(line) for lines in shown.values() for line in lines) > columns - 10


def test_pipe_has_whole_sentences(robot: Path, tmp_path: Path) -> None:
    shown = in_pipe(copy_files(robot, tmp_path), *COMMANDS)

    assert len(shown) == len(COMMANDS)
    for command, lines in shown.items():
        if words_of(command) not in OWN_LINES:
            assert list(broken_early(lines, 1_000_000)) == [], command
