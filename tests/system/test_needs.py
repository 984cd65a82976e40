"""Skips are told with their reason, and fail the run where CI forbids them."""

import os
import subprocess
import sys
from pathlib import Path

import pytest

from tests import needs
from tests.needs import CHECKOUT

pytestmark = pytest.mark.needs("posix")

NEVER_HERE = '@pytest.mark.needs("windows")\ndef test_it() -> None:\n    assert True\n'
PLAIN_SKIP = 'def test_it() -> None:\n    pytest.skip("no time")\n'
MISSPELT = '@pytest.mark.needs("posiks")\ndef test_it() -> None:\n    assert True\n'


def run_pytest(folder: Path, text: str, *, no_skips: bool, workers: str = "0") -> subprocess.CompletedProcess[str]:
    test = folder / "test_tried.py"
    test.write_text("import pytest\n\n\n" + text, encoding="utf-8", newline="\n")
    environment = {name: value for name, value in os.environ.items() if not name.startswith("PYTEST_")}
    rules = [
        "-c",
        str(CHECKOUT / "pyproject.toml"),
        "--rootdir",
        str(folder),
        "-p",
        "tests.conftest",
        "-p",
        "no:cacheprovider",
        "-n",
        workers,
    ]
    return subprocess.run(
        [sys.executable, "-m", "pytest", *rules, str(test)],
        cwd=CHECKOUT,
        env=environment | {"RARMS_NO_SKIPS": "1" if no_skips else ""},
        capture_output=True,
        text=True,
        encoding="utf-8",
    )


def test_a_missing_need_skips_with_its_reason(tmp_path: Path) -> None:
    done = run_pytest(tmp_path, NEVER_HERE, no_skips=True)

    assert done.returncode == 0, done.stdout
    assert "needs windows: this is not Windows" in done.stdout


@pytest.mark.parametrize("workers", ["0", "2"])
def test_skip_without_excuse_fails_where_skips_are_forbidden(tmp_path: Path, workers: str) -> None:
    allowed = run_pytest(tmp_path, PLAIN_SKIP, no_skips=False, workers=workers)
    forbidden = run_pytest(tmp_path, PLAIN_SKIP, no_skips=True, workers=workers)

    assert allowed.returncode == 0, allowed.stdout
    assert forbidden.returncode == 1, forbidden.stdout
    assert "skips that fail this run" in forbidden.stdout
    assert "no time" in forbidden.stdout


def test_an_unknown_need_is_an_error(tmp_path: Path) -> None:
    done = run_pytest(tmp_path, MISSPELT, no_skips=False)

    assert done.returncode == pytest.ExitCode.USAGE_ERROR
    assert "needs posiks, which tests/needs.py lacks" in done.stdout + done.stderr


def test_every_need_answers_readably() -> None:
    for name, need in needs.NEEDS.items():
        reason = needs.reason_to_skip(name)
        assert bool(reason) == bool(need.missing())
        assert not reason or needs.is_excused(reason) != need.obtainable()
