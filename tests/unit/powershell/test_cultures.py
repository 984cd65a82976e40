"""Scripts mean the same in every culture: to a Turkish one I and i are two letters, also in 5.1's keys of tables."""

import re
from dataclasses import replace

import pytest

from rarms_iac.powershell.templates import MEASURING_PARTS, part_text, template_text
from tests.fake_powershell.cell import apply, undo
from tests.fake_powershell.cells import fresh
from tests.fake_powershell.observing import PROFILE
from tests.fake_powershell.values import Table, Unsupported
from tests.powershell_lint.tree import parse, text_of, walk

TEXTS = {
    "module": template_text("Rarms/Rarms.psm1"),
    **{f"part {name}": part_text(name) for name in MEASURING_PARTS},
    "observe": template_text("observe.ps1"),
}
templates = pytest.mark.parametrize("name", TEXTS)

BY_CULTURE = re.compile(
    r"-(i?match|i?notmatch|i?like|i?notlike|csplit)|ToLower|ToUpper|ToTitleCase|CompareTo|StartsWith", re.IGNORECASE
)
ORDINAL = {"ToLowerInvariant", "ToUpperInvariant"}


@templates
def test_no_word_of_template_depends_on_culture(name: str) -> None:
    """`-cmatch` and its like tell case; `-eq`, `-contains` and `-replace` go by the invariant culture."""
    leaves = [node for node in walk(parse(TEXTS[name])) if node.child_count == 0]
    found = [text_of(leaf) for leaf in leaves if leaf.type not in {"comment", "verbatim_string_characters"}]

    assert [word for word in found if BY_CULTURE.fullmatch(word) and word not in ORDINAL] == []
    assert not [word for word in found if word.lower().endswith(("tolower", "toupper"))]


@templates
def test_no_number_is_shaped_by_the_culture(name: str) -> None:
    """Holes of `-f` have widths and hexadecimal digits, which are the same everywhere; no N, D or date."""
    texts = [text_of(node) for node in walk(parse(TEXTS[name])) if node.type == "string_literal"]
    holes = [hole for text in texts for hole in re.findall(r"\{[0-9]+(?:,-?[0-9]+)?(:[^}]*)?\}", text)]

    assert set(holes) <= {"", ":x4"}
    assert "ToString()" not in TEXTS[name]


@pytest.mark.parametrize("name", ["module", *(f"part {name}" for name in MEASURING_PARTS)])
def test_script_tables_compare_keys_by_characters(name: str) -> None:
    """A table that is written out has words of ours as keys; all others are given `$script:Ordinal`."""
    text = TEXTS[name]

    empty = re.findall(r"^.*@\{ *\}.*$", text, flags=re.MULTILINE)
    assert [line for line in empty if line != "$PSDefaultParameterValues = @{}"] == []
    made = re.findall(r"(?i)\[[a-z.]*(?:hashtable|dictionary)\]::new\(.*?\)", text)
    assert [table for table in made if not table.endswith("$script:Ordinal)")] == []
    tables = re.findall(r"(?<!DefaultParameterValues = )@\{([^{}]+)\}", text)
    keys = [entry.split("=")[0].strip() for table in tables for entry in re.split(r"[;\n]", table) if "=" in entry]
    assert [key for key in keys if not re.fullmatch("[A-Za-z_]+", key)] == []


def test_names_equal_in_a_culture_stay_two() -> None:
    prepared = fresh()
    host = prepared.copy()
    assert apply(host, prepared.plan).code == 0
    task = host.add_key(f"{PROFILE}\\Tasks\\Localization").values
    task["pri\u00adority"] = replace(task["priority"], name="Pri\u00adority")

    ran = undo(host, prepared.plan)

    assert ran.code == 3, ran.says
    assert "changed since the plan: value:pri" in ran.says


@pytest.mark.parametrize("other", ["value:SFIO", "value:sf\u00adio"])
def test_stand_in_refuses_key_that_culture_decides_about(other: str) -> None:
    table = Table([("value:sfio", 1)])

    with pytest.raises(Unsupported):
        table.at(other)
    assert Table([("value:sfio", 1)], ordinal=True).at(other) is None
