from pathlib import Path

import pytest

from scripts.house_rules import PACKAGE, breaches

READS = "this reads a sentence: what code needs is a field"


@pytest.mark.parametrize(
    "planted",
    [
        'finding.message.removeprefix("it is held by ")',
        'str(finding.advice).replace("at most", "<=")',
        '"rarms plan" in finding.advice',
        're.search("[0-9]+ %", finding.detail)',
        'pattern.sub("", f"{finding.summary}.")',
        'step.comment.split("; ")[1]',
        'show_threshold(index, threshold).partition(" ")',
        '(change.reason + ".").startswith("asked")',
        'render(text).endswith("done")',
    ],
)
def test_code_that_reads_a_sentence_is_found(tmp_path: Path, planted: str) -> None:
    (tmp_path / "views").mkdir()
    (tmp_path / "views" / "plan.py").write_text(f"value = {planted}\n", encoding="utf-8")

    assert [breach.partition(": ")[2] for breach in breaches(tmp_path) if "views/plan.py" in breach] == [READS]


@pytest.mark.parametrize(
    "planted",
    [
        'line.startswith("ready")',
        "replace(finding, detail=detail)",
        'f"{finding.detail} {finding.advice}"',
        "code in CODES",
    ],
)
def test_what_others_print_and_text_that_is_made_is_no_breach(tmp_path: Path, planted: str) -> None:
    (tmp_path / "plan.py").write_text(f"value = {planted}\n", encoding="utf-8")

    assert [breach for breach in breaches(tmp_path) if "plan.py" in breach] == []


def test_the_package_reads_no_sentence() -> None:
    assert [breach for breach in breaches(PACKAGE) if READS in breach] == []
