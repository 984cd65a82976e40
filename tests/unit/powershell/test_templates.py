"""The module that scripts call: its two files, and how a script finds or holds it."""

import hashlib
import re

import pytest

from rarms_iac.model.version import __version__
from rarms_iac.powershell.render import render_observe, render_scripts
from rarms_iac.powershell.templates import (
    MODULE_FILES,
    ScriptForm,
    module_digest,
    module_file,
    shipped_module,
    template_text,
    without_signature,
)
from tests.powershell_lint.tree import parse, text_of
from tests.unit.powershell.plans import all_changes, rendered_plan

SCRIPTS = {
    (form, name): text.decode("ascii")
    for form in ScriptForm
    for name, text in render_scripts(*rendered_plan(), form=form).items()
}
scripts = pytest.mark.parametrize(("form", "name"), sorted(SCRIPTS, key=str))
MODULE = template_text("Rarms/Rarms.psm1")


def test_the_module_can_be_read_in_one_sitting() -> None:
    assert MODULE.count("\n") <= 1500
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
    assert module_digest(text.replace("Stop-Run", "Stop-Ran", 1)) != module_digest(text)


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

    assert script.count("\n") <= 80
    assert undo.count("\n") <= 80
