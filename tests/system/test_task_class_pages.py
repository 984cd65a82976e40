"""The programs of docs/task-classes.md, compiled by mingw and run under wine against the tests' own avrt.dll."""

import os
import re
import shutil
import subprocess
from pathlib import Path

import pytest

from rarms_iac.rcss import _EXPLANATIONS
from tests.needs import CHECKOUT

PAGE = CHECKOUT / "docs" / "task-classes.md"
WINDOWS = CHECKOUT / ".cache" / "windows"
COMPILERS = {"c": "x86_64-w64-mingw32-gcc", "cpp": "x86_64-w64-mingw32-g++"}
UNDER_WINE = {**os.environ, "WINEPREFIX": str(WINDOWS / "prefix"), "WINEDEBUG": "-all", "WINEDLLOVERRIDES": "avrt=n"}


def program(language: str, name: str) -> str:
    """The page's program, which asks for this class."""
    found = re.findall(rf"^```{language}\n(.*?)^```$", PAGE.read_text(encoding="utf-8"), re.MULTILINE | re.DOTALL)
    assert len(found) == 1
    assert found[0].count('L"SpeechRecognition"') == 1
    return str(found[0]).replace('L"SpeechRecognition"', f'L"{name}"')


@pytest.mark.needs("wine", "mingw")
@pytest.mark.parametrize(
    ("language", "name"),
    [
        pytest.param("c", "SpeechRecognition", marks=pytest.mark.sample),
        *(("c", name) for name in ("Error1550", "Error1551", "Error1552", "Error1314")),
        *(("cpp", name) for name in ("SpeechRecognition", "Error1550")),
    ],
)
def test_program_of_page_joins_or_says_why_not(language: str, name: str, tmp_path: Path) -> None:
    subprocess.run([CHECKOUT / "scripts" / "windows-python"], check=True)
    shutil.copy(WINDOWS / "avrt" / "avrt.dll", tmp_path)
    source = tmp_path / f"component.{language}"
    source.write_text(program(language, name), encoding="utf-8")
    words = [COMPILERS[language], "-Wall", "-Werror", "-static", "-o", "component.exe", source.name, "-lavrt"]
    subprocess.run(words, cwd=tmp_path, check=True)

    ran = subprocess.run(
        ["wine", "component.exe"], cwd=tmp_path, env=UNDER_WINE, stdin=subprocess.DEVNULL, capture_output=True
    )

    refused = name.removeprefix("Error")
    assert ran.returncode == int(name.startswith("Error")), ran.stderr
    assert (refused.encode() in ran.stderr) is name.startswith("Error")


def test_page_explains_errors_that_component_is_told() -> None:
    rows = re.findall(r"^\| (\d+) \|", PAGE.read_text(encoding="utf-8"), re.MULTILINE)

    assert sorted(map(int, rows)) == sorted(_EXPLANATIONS)
