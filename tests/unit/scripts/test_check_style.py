from pathlib import Path

import pytest

from scripts.check_style import breaches_in


@pytest.mark.parametrize(
    ("planted", "breach"),
    [
        ('value = finding.message.removeprefix("it is held by ")', "this reads a sentence"),
        ('value = "rarms plan" in finding.advice', "this reads a sentence"),
        ("text = path.read_text()", "this opens a file"),
        ('file = path.open("rb")', "this opens a file"),
        ("file = os.open(path, 0)", "this opens a file"),
        ("class Host: ...\n\n\nclass Host: ...", "class Host is also in"),
        ("from tests.builders import a_system", "the package is installed without benchmarks and tests"),
    ],
)
def test_a_breach_is_found(tmp_path: Path, planted: str, breach: str) -> None:
    (tmp_path / "plan.py").write_text(f"{planted}\n", encoding="utf-8")

    (found,) = breaches_in(tmp_path)
    assert breach in found


@pytest.mark.parametrize(
    "planted",
    [
        'value = line.startswith("ready")',
        "file = os.open(os.devnull, 0)",
        'value = f"{finding.detail} {finding.advice}"',
    ],
)
def test_other_code_is_not(tmp_path: Path, planted: str) -> None:
    (tmp_path / "plan.py").write_text(f"{planted}\n", encoding="utf-8")

    assert list(breaches_in(tmp_path)) == []
