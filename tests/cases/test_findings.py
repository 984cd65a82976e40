"""Manifests with something wrong, and exactly what is told of them."""

import json
import re
from pathlib import Path

import pytest

from rarms_iac.manifest.checks.violation import CHECKS
from rarms_iac.model.diagnostics import Diagnostic
from rarms_iac.model.wording import quoted
from tests.cases.findings_of import case_folders, diagnostics_of, findings_of

NAME = re.compile(r'"([^"]+)"')


@pytest.mark.parametrize("folder", case_folders(), ids=lambda folder: folder.name)
def test_a_case_tells_what_it_should(folder: Path) -> None:
    expected = (folder / "expected.txt").read_text(encoding="utf-8")

    assert findings_of(folder) == expected


@pytest.mark.parametrize("folder", case_folders(), ids=lambda folder: folder.name)
def test_a_case_says_why_it_is_there(folder: Path) -> None:
    assert (folder / "WHY").read_text(encoding="utf-8").strip()


def test_every_check_has_a_case() -> None:
    told = "".join((folder / "expected.txt").read_text(encoding="utf-8") for folder in case_folders())

    assert [finding.code for finding in CHECKS if f"[{finding.code}]" not in told] == []


@pytest.mark.parametrize("folder", case_folders(), ids=lambda folder: folder.name)
def test_each_name_in_a_sentence_is_a_field_too(folder: Path) -> None:
    lacking = [
        (diagnostic.code, name)
        for diagnostic in diagnostics_of(folder)
        for name in NAME.findall(diagnostic.detail)
        if not any(name in fact for fact in _facts(diagnostic))
    ]

    assert not lacking


def _facts(diagnostic: Diagnostic) -> list[str]:
    facts = [fact if isinstance(fact, tuple) else (fact,) for fact in diagnostic.values.values()]
    texts = [str(part) for fact in facts for part in fact]
    return [*texts, *(quoted(json.dumps(text, ensure_ascii=False)) for text in texts)]  # as sentences spell them out
