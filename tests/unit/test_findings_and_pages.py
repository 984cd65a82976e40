"""Every finding of the package has its own code and its own page, and every page its finding."""

import importlib
import pkgutil
import re

import pytest

import rarms_iac
from rarms_iac.manifest.checks.violation import CHECKS
from rarms_iac.model.diagnostics import Finding
from rarms_iac.storage.finding_pages import finding_page, known_codes, severity_line
from rarms_iac.storage.shipped import shipped
from scripts.findings_index import index_of_pages


def findings_of_the_package() -> dict[str, tuple[str, Finding]]:
    """Module and finding by code; the module is where the constant is defined, not where it is imported."""
    found: dict[str, tuple[str, Finding]] = {}
    for module in pkgutil.walk_packages(rarms_iac.__path__, "rarms_iac."):
        if module.name.endswith(("__main__", "_windows")):  # what only Windows can import
            continue
        for value in vars(importlib.import_module(module.name)).values():
            if isinstance(value, Finding):
                _add(found, module.name, value)
    for finding, _ in CHECKS:  # most stand above their check alone
        _add(found, "rarms_iac.manifest.checks", finding)
    return found


def _add(found: dict[str, tuple[str, Finding]], module: str, finding: Finding) -> None:
    before, same = found.setdefault(finding.code, (module, finding))
    assert same is finding, f"{finding.code} is defined twice: in {before} and in {module}"


FINDINGS = findings_of_the_package()
MOST_WORDS = 120
"""Of a page, without its examples."""


def test_codes_have_form_that_pages_and_acceptances_expect() -> None:
    assert FINDINGS
    assert [code for code in FINDINGS if not (len(code) == 8 and code.startswith("RARMS") and code[5:].isdigit())] == []


@pytest.mark.parametrize("code", sorted(FINDINGS))
def test_finding_has_page_that_says_same(code: str) -> None:
    finding = FINDINGS[code][1]

    page = finding_page(code)

    assert page is not None, f"write docs/findings/{code}.md"
    assert page.splitlines()[0] == f"# {code}: {finding.summary}"
    assert severity_line(page).split(",")[0] == finding.severity.value
    assert page.endswith("\n")
    assert len(re.sub(r"```.*?```", "", page, flags=re.DOTALL).split()) <= MOST_WORDS


def test_no_page_is_left_without_a_finding() -> None:
    assert set(known_codes()) - set(FINDINGS) == set()


def test_the_index_lists_the_pages_as_they_are() -> None:
    index = shipped("docs/findings").parent / "diagnostics.md"
    if not index.is_file():
        pytest.skip("the index lies in the checkout only")

    assert index.read_text(encoding="utf-8") == index_of_pages(), "run scripts/findings_index.py"
