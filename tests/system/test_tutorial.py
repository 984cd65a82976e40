"""docs/tutorial.md: each of its commands ends as it says there, and its pictures are there."""

import os
import re
import shlex
from contextlib import chdir
from pathlib import Path

from tests.unit.cli.running import rarms

DOCS = Path(__file__).parents[2] / "docs"
COMMAND = re.compile(r"^\$ (.*?)(?:\s+# ends with (\d+):.*)?$", re.MULTILINE)


def test_each_command_of_the_tutorial_ends_as_it_says(tmp_path: Path) -> None:
    text = (DOCS / "tutorial.md").read_text(encoding="utf-8")
    ended: list[tuple[str, int]] = []
    expected: list[tuple[str, int]] = []

    with chdir(tmp_path):
        for command, code in COMMAND.findall(text):
            program, *words = shlex.split(command)
            if program == "cd":
                os.chdir(words[0])
                continue
            assert program == "rarms"
            expected.append((command, int(code or 0)))
            ended.append((command, rarms(*words).code))

    assert len(ended) > 10
    assert ended == expected


def test_every_picture_of_a_page_is_there() -> None:
    pictures = [
        (page, picture)
        for page in sorted(DOCS.glob("*.md"))
        for picture in re.findall(r"!\[[^\]]*\]\(([^)]+)\)", page.read_text(encoding="utf-8"))
    ]

    assert pictures
    assert [(page.name, picture) for page, picture in pictures if not (page.parent / picture).is_file()] == []
