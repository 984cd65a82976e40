"""Every finding of the package has its own code and its own page, and every page its finding."""

import importlib
import pkgutil
import re
from pathlib import Path

import pytest

import rarms_iac
from rarms_iac.manifest.checks.violation import CHECKS
from rarms_iac.model.quantities import Percent, ShareOfHost
from rarms_iac.storage.shipped import finding_page, known_codes, severity_line, shipped
from rarms_iac.texts.findings import Finding
from scripts.findings_index import index_of_pages
from tests import builders


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
"""Of a page, with its example."""


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
    assert len(page.split()) <= MOST_WORDS


def test_no_page_is_left_without_a_finding() -> None:
    assert set(known_codes()) - set(FINDINGS) == set()


def test_the_index_lists_the_pages_as_they_are() -> None:
    index = shipped("docs/findings").parent / "diagnostics.md"
    if not index.is_file():
        pytest.skip("the index lies in the checkout only")

    assert index.read_text(encoding="utf-8") == index_of_pages(), "run scripts/findings_index.py"


GLOSSARY = Path(__file__).parents[2] / "docs" / "glossary.md"
WORDS = """CoI|compound CoI|PI|APT|criticality|interfering load|partition|CR|LP|component
compute_minimum_cpu_reservation
combine_components|tune_performance_to_use_less_resource|manifest|desired|observed|resource|address|provider|action
change|step|plan|drift|apply|journal|data log|configuration log|overlay|layout|disruption|mark|serial|setting|platform
finding|diagnostic|acceptance|task class|reserve|limit|weight|snapshot|undo|lock|curve|RC SS|MMCSS
VP|BLP|compound|combine|TPTULR|CMCPUR|P1|environment setup|severity|steady state|99 % confidence"""


def entries() -> dict[str, str]:
    """The words in the first column, each with its meaning."""
    rows = re.findall(r"^\| (.+?) \| (.+) \|$", GLOSSARY.read_text(encoding="utf-8"), flags=re.MULTILINE)
    return {
        word.strip("` "): message
        for words, message in rows
        for word in re.split(r", | \(|\)", words)
        if words != "term"
    }


@pytest.mark.parametrize("word", re.split(r"[|\n]", WORDS))
def test_a_word_that_we_use_is_explained(word: str) -> None:
    assert len(entries()[word]) > 15


def test_no_word_is_explained_twice() -> None:
    first = re.findall(r"^\| (.+?) \|", GLOSSARY.read_text(encoding="utf-8"), flags=re.MULTILINE)
    words = [word for word in first if word not in {"term", "---"}]

    assert sorted(set(words)) == sorted(words)


MOST_OWN_TERMS = 10


def test_glossary_has_at_most_ten_own_terms() -> None:
    table = GLOSSARY.read_text(encoding="utf-8").partition("\n## Terms of our own\n")[2].partition("\n## ")[0]

    own = [row for row in re.findall(r"^\| (.+?) \|", table, flags=re.MULTILINE) if row != "term"]

    assert 0 < len(own) <= MOST_OWN_TERMS


def test_navigation_names_each_page_once() -> None:
    navigation = re.findall(r'"([\w/-]+\.md)"', (GLOSSARY.parents[1] / "zensical.toml").read_text(encoding="utf-8"))
    pages = [path.name for path in GLOSSARY.parent.glob("*.md")]

    assert sorted(navigation) == sorted([*pages, "decisions/README.md"])


def test_each_decision_is_in_the_list_of_decisions() -> None:
    folder = GLOSSARY.parent / "decisions"
    listed = re.findall(r"\]\((\d{4}-[\w-]+\.md)\)", (folder / "README.md").read_text(encoding="utf-8"))

    assert sorted(set(listed)) == sorted(path.name for path in folder.glob("0*.md"))


TEMPLATES = sorted(Path(str(shipped("templates"))).rglob("*.j2"))


def test_there_are_templates_of_scripts_and_of_report() -> None:
    assert [path.name for path in TEMPLATES] == [
        "bootstrap.ps1.j2",
        "loader.ps1.j2",
        "module.ps1.j2",
        "observe.ps1.j2",
        "script.ps1.j2",
        "single.ps1.j2",
        "report.html.j2",
        "studio-card.html.j2",
        "studio-forms.html.j2",
        "studio-history.html.j2",
        "studio-plan.html.j2",
        "studio-top.html.j2",
        "studio-ways.html.j2",
        "studio-work.html.j2",
        "table.html.j2",
    ]


SCRIPTS = [path for path in TEMPLATES if path.name.startswith("script.")]


@pytest.mark.parametrize("template", SCRIPTS, ids=lambda path: path.name)
def test_template_of_scripts_has_loops_and_nothing_else(template: Path) -> None:
    text = template.read_text(encoding="utf-8")

    statements = re.findall(r"\{%-?\s*(.*?)\s*-?%\}", text)
    assert statements
    assert [
        statement for statement in statements if not re.fullmatch(r"for \w+(, \w+)* in \w+(\.\w+)*|endfor", statement)
    ] == []
    assert [
        expression
        for expression in re.findall(r"\{\{\s*(.*?)\s*\}\}", text)
        if not re.fullmatch(r"\w+(\.\w+)*", expression)
    ] == []
    assert "{#" not in text


def test_unsaid_fields_are_valid() -> None:
    component = builders.a_component("speech", reserve="30 %", memory="256 MiB")

    assert component.cpu.reserve == ShareOfHost(Percent(builders.percent("30 %")))
    assert component.memory == 256 * 2**20


def test_a_periodic_run_has_its_period_as_deadline() -> None:
    assert builders.a_run(every="33 ms").deadline == 33
    assert builders.a_run().deadline is None
