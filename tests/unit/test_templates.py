"""The template of scripts places values and decides nothing: loops are all its logic (docs/scripts.md)."""

import re
from pathlib import Path

import pytest

from rarms_iac.storage.shipped import shipped

TEMPLATES = sorted(Path(str(shipped("templates"))).rglob("*.j2"))


def test_there_are_templates_of_scripts_and_of_report() -> None:
    assert [path.name for path in TEMPLATES] == [
        "bootstrap.ps1.j2",
        "loader.ps1.j2",
        "module.ps1.j2",
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
