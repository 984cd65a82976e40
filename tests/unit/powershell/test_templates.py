"""The module that scripts call: its two files, and how a script finds or holds it."""

import hashlib
import re
from dataclasses import replace

import pytest
from hypothesis import given
from hypothesis import strategies as st

from rarms_iac.model.version import __version__
from rarms_iac.powershell.literals import LARGEST, MOST_PARTS, NoLiteral, literal
from rarms_iac.powershell.render import render_observe, render_scripts
from rarms_iac.powershell.templates import (
    MEASURING_PARTS,
    MODULE_FILES,
    ScriptForm,
    module_digest,
    module_file,
    part_text,
    shipped_module,
    template_text,
    without_signature,
)
from rarms_iac.texts.messages import remark
from tests.fake_powershell.cell import apply, undo
from tests.fake_powershell.cells import fresh
from tests.fake_powershell.compiling import compiled
from tests.fake_powershell.host import WindowsHost
from tests.fake_powershell.observing import PROFILE
from tests.fake_powershell.scopes import Scope, Session
from tests.fake_powershell.values import Table, Unsupported, Value
from tests.powershell_lint.tree import parse, text_of, walk
from tests.unit.powershell.hostile import hostile_texts
from tests.unit.powershell.plans import all_changes, rendered_plan

SCRIPTS = {
    (form, name): text.decode("ascii")
    for form in ScriptForm
    for name, text in render_scripts(*rendered_plan(), form=form).items()
}
scripts = pytest.mark.parametrize(("form", "name"), sorted(SCRIPTS, key=str))
MODULE = template_text("Rarms/Rarms.psm1")


def test_the_module_can_be_read_in_one_sitting() -> None:
    assert MODULE.count("\n") <= 1670
    assert max(map(len, MODULE.split("\n"))) <= 125


def test_nothing_runs_while_the_module_is_imported() -> None:
    """At its top stand settings, constants and functions."""
    (program,) = [node for node in parse(MODULE).children if node.type == "statement_list"]
    texts = [text_of(node) for node in program.children if node.type not in {"comment", "function_statement"}]

    assert [text for text in texts if not re.match(r"Set-StrictMode -Version 3.0$|\$[A-Za-z:]+ = ['@\[]", text)] == []


def test_module_manifest_names_version_and_exports() -> None:
    manifest = template_text("Rarms/Rarms.psd1")
    exported = re.search(r"FunctionsToExport    = @\(([^)]*)\)", manifest)

    assert f"ModuleVersion        = '{__version__}'" in manifest
    assert exported is not None
    for name in re.findall("'([^']+)'", exported[1]):
        assert f"\nfunction {name} {{\n    <#\n    .SYNOPSIS\n" in MODULE


def test_module_holds_digest_of_script_that_observes() -> None:
    digest = hashlib.sha256(render_observe()).hexdigest()

    assert f"$script:Observe = '{digest}'\n" in MODULE, f"write this digest there: {digest}"


def test_signature_does_not_change_module_digest() -> None:
    text = module_file(MODULE_FILES[1]).decode("ascii")
    block = "\r\n# SIG # Begin signature block\r\n# MII\r\n# SIG # End signature block\r\n"

    assert without_signature(text + block) == text
    assert module_digest(text + block) == module_digest(text)
    assert module_digest(text.replace("Exit-Run", "Exit-Ran", 1)) != module_digest(text)


@scripts
def test_script_names_or_holds_its_module(form: ScriptForm, name: str) -> None:
    script = SCRIPTS[form, name]

    if form is ScriptForm.MODULE:
        assert [digest for digest in map(module_digest, shipped_module().values()) if digest not in script] == []
        assert script.count("\n") < 300
    else:
        assert MODULE.replace("\n", "\r\n") in script


def test_guest_s_script_says_nothing_of_host() -> None:
    script = SCRIPTS[ScriptForm.MODULE, "onboard.guest.speech.ps1"]

    assert "Hyper-V" not in script
    assert "LogicalProcessors" not in script


def test_a_changed_reserve_is_a_short_script() -> None:
    (change, *_) = all_changes()

    script, undo = (text.decode("ascii") for _, text in sorted(render_scripts(*rendered_plan([change])).items()))

    assert script.count("\n") <= 85
    assert undo.count("\n") <= 85


TEXTS = {
    "module": template_text("Rarms/Rarms.psm1"),
    **{f"part {name}": part_text(name) for name in MEASURING_PARTS},
    "observe": render_observe().decode("ascii").replace("\r\n", "\n"),
}
templates = pytest.mark.parametrize("name", TEXTS)


@templates
def test_no_number_is_shaped_by_the_culture(name: str) -> None:
    """Holes of `-f` have widths and hexadecimal digits, which are the same everywhere; no N, D or date."""
    texts = [text_of(node) for node in walk(parse(TEXTS[name])) if node.type == "string_literal"]
    holes = [hole for text in texts for hole in re.findall(r"\{[0-9]+(?:,-?[0-9]+)?(:[^}]*)?\}", text)]

    assert set(holes) <= {"", ":x4"}
    assert "ToString()" not in TEXTS[name]


ORDINAL_DEFAULT = "    param([System.Collections.IDictionary] $From = @{})"


@pytest.mark.parametrize("name", ["module", *(f"part {name}" for name in MEASURING_PARTS)])
def test_script_tables_compare_keys_by_characters(name: str) -> None:
    """A table that is written out has words of ours as keys; `Get-OrdinalTable` makes all others."""
    text = TEXTS[name]

    empty = re.findall(r"^.*@\{ *\}.*$", text, flags=re.MULTILINE)
    assert [line for line in empty if line not in {"$PSDefaultParameterValues = @{}", ORDINAL_DEFAULT}] == []
    made = re.findall(r"(?i)\[[a-z.]*(?:hashtable|dictionary)\]::new\(.*\)", text)
    assert made == ["[hashtable]::new($From, [System.StringComparer]::Ordinal)"] * (name == "module")
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


@pytest.mark.parametrize(
    ("value", "written"),
    [
        ("", "''"),
        ("O'Brien", "'O''Brien'"),
        ("$(x) `n", "'$(x) `n'"),
        ("right\u2019", "('' + 'right' + [char]0x2019)"),
        ("\U0001f600", "('' + [char]0xD83D + [char]0xDE00)"),
        ("a\r\nb", "('' + 'a' + [char]0x000D + [char]0x000A + 'b')"),
        (True, "$true"),
        (False, "$false"),
        (0, "0"),
        (536870912, "536870912"),
    ],
)
def test_each_form(value: bool | int | str, written: str) -> None:
    assert literal(value) == written


@pytest.mark.parametrize("value", [-1, LARGEST + 1, "\ud800", "x\udfff", "é" * (MOST_PARTS + 1)])
def test_unrepresentable_value_is_refused(value: int | str) -> None:
    with pytest.raises(NoLiteral) as refused:
        literal(value)

    assert refused.value.value == value
    assert refused.value.why


def evaluated(written: list[str]) -> list[Value]:
    """What these literals give as statements of a script."""
    values: list[Value] = []
    session = Session(WindowsHost(), windows_powershell=True, path="C:\\x.ps1", declined=frozenset())
    compiled("".join(f"{text}\r\n" for text in written).encode("ascii")).body(Scope(session, None), values)
    return [_joined(value) if isinstance(value, str) else value for value in values]


def _joined(text: str) -> str:
    """Two halves of a surrogate pair as one character, which they are to PowerShell."""
    return text.encode("utf-16-le", "surrogatepass").decode("utf-16-le")


@given(st.lists(st.one_of(st.booleans(), st.integers(0, LARGEST), st.text(max_size=60)), min_size=1))
def test_any_value_is_what_its_literal_gives(values: list[bool | int | str]) -> None:
    written = [literal(value) for value in values]

    assert all(text.isascii() and text.isprintable() for text in written)
    assert evaluated(written) == values


def test_a_remark_stays_on_its_line() -> None:
    for text in hostile_texts(2_000):
        assert remark(text).isascii()
        assert remark(text).isprintable()
