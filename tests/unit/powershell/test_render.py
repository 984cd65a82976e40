import hashlib
import re
from dataclasses import replace

import pytest

from rarms_iac.model.changes import Change
from rarms_iac.model.plan import HostPlan, Plan
from rarms_iac.model.renaming import BETWEEN
from rarms_iac.powershell.literals import NoLiteral
from rarms_iac.powershell.render import render_scripts, script_name
from rarms_iac.powershell.templates import ScriptForm, fill, template_text
from rarms_iac.providers.marks import write_mark
from tests import builders_plan as build
from tests.builders import a_mark
from tests.effort import examples
from tests.powershell_lint.tree import structure
from tests.unit.powershell.hostile import hostile_texts
from tests.unit.powershell.plans import all_changes, marked, rendered_plan


def host_script(on: HostPlan, plan: Plan) -> bytes:
    """The script of the host itself that does this plan."""
    return render_scripts(on, plan)["onboard.ps1"]


def steps_of(script: bytes) -> str:
    """The head and the plan, with LF."""
    return script.decode("ascii").replace("\r\n", "\n").partition("#region The module")[0]


def renamed(change: Change, name: str, message: str) -> Change:
    """This change, of a machine with this name, for this reason: names of unmanaged machines may be anything."""
    reason = build.because(message)
    match change.kind:
        case "adopt" | "release" | "create" | "update" | "delete":
            return replace(change, reason=reason, address=replace(change.address, machine=name))
        case _:
            raise AssertionError(change.kind)


def test_one_script_and_undo_per_system() -> None:
    scripts = render_scripts(*rendered_plan())

    assert sorted(scripts) == [
        "onboard.guest.speech.ps1",
        "onboard.guest.speech.undo.ps1",
        "onboard.ps1",
        "onboard.undo.ps1",
    ]
    assert scripts == render_scripts(*rendered_plan())  # the same input, the same bytes


def test_a_script_knows_its_undo_by_its_bytes() -> None:
    on, plan = rendered_plan()
    scripts = render_scripts(on, plan)

    digest = hashlib.sha256(scripts[script_name(on, undo=True)]).hexdigest()

    assert f"UndoDigest = '{digest}'" in steps_of(scripts[script_name(on)])
    assert f"Undo = '{script_name(on, undo=True)}'" in steps_of(scripts[script_name(on)])


def test_both_forms_share_head_plan_and_end() -> None:
    on, plan = rendered_plan()
    texts = {
        form: {name: text.decode("ascii") for name, text in render_scripts(on, plan, form=form).items()}
        for form in ScriptForm
    }

    for name in texts[ScriptForm.MODULE]:
        module, single = (re.sub("[0-9a-f]{64}", "", texts[form][name]) for form in ScriptForm)
        cut = r"(?ms)^#region The module.*?^#endregion"
        assert re.sub(cut, "", module) == re.sub(cut, "", single)
        assert module != single


def test_each_start_has_a_banner() -> None:
    host_plan, plan = rendered_plan()
    starts = [step.address for step in host_plan.steps if step.title == "start it"]

    told = re.findall(r"# === ([a-z]+): start it .*", steps_of(host_script(host_plan, plan)))

    assert starts
    assert told == [address.partition for address in starts]


def test_child_of_older_disk_has_its_parents_format() -> None:
    new = build.create(marked(replace(build.partition(build.settings("planning")), id="")))

    text = steps_of(host_script(*rendered_plan([new], image="D:\\images\\old.VHD")))

    disk = "D:\\vms\\planning\\planning-0123456789ab.vhd"
    assert f"-Path '{disk}' -ParentPath 'D:\\images\\old.VHD' -Differencing\n" in text


def test_nothing_that_a_value_says_changes_the_structure() -> None:
    harmless = all_changes()[5]
    template = structure(host_script(*rendered_plan([renamed(harmless, "x", "y")])).decode("ascii"))

    for text in hostile_texts(examples(5), seed=23):
        named = renamed(harmless, f"a{text}", text or "because")
        script = host_script(*rendered_plan([named])).decode("ascii")
        assert structure(script) == template


def test_half_a_character_has_no_literal() -> None:
    with pytest.raises(NoLiteral):
        host_script(*rendered_plan([renamed(all_changes()[5], "\ud800", "why")]))


def test_a_template_that_asks_for_more_fails() -> None:
    from jinja2 import UndefinedError

    with pytest.raises(UndefinedError):
        fill("script.ps1.j2", {"requirements": [], "name": "", "plan": [], "module": ""})


def test_module_reads_every_mark() -> None:
    module = template_text("Rarms/Rarms.psm1")
    forms = {}
    for name in ("form", "set", "name"):
        found = re.search(rf"\${name} = '([^']+)'", module)
        assert found is not None
        forms[name] = found[1]
    pattern = re.compile(
        forms["form"].replace("SET", forms["set"]).replace("NAME", forms["name"]).replace("(?<", "(?P<")
    )

    for name in ("vision", "vision" + BETWEEN):
        mark = a_mark("0a1b2c3d-0000", "robot", name, "0123456789ab")
        written = write_mark("my notes\r\n", mark).replace("\n", "\r\n").split("\n")
        (found,) = filter(None, map(pattern.search, written))
        assert found.groupdict() == {"app": "robot", "name": name, "vm": "0a1b2c3d", "set": "0123456789ab"}
