"""Machines alike stand as rows of a table; `tests/fake_powershell` runs such scripts."""

import hashlib
import re
from dataclasses import fields, replace

import pytest
from tree_sitter import Node

from rarms_iac.model.changes import Change
from rarms_iac.model.names import BETWEEN
from rarms_iac.model.plan import HostPlan, HostSteps, Plan, RunIdentity
from rarms_iac.powershell.comparison import Detail, ScriptDifference, ScriptSteps, compare_steps
from rarms_iac.powershell.literals import NoLiteral
from rarms_iac.powershell.render import render_scripts, script_name, script_steps
from rarms_iac.powershell.rows import PlanBlock, plan_lines
from rarms_iac.powershell.templates import (
    HOST_FACT_NAMES,
    ScriptForm,
    StepText,
    fill,
    module_digests,
    shipped_module,
    template_text,
)
from rarms_iac.providers.machines import write_mark
from tests import builders_plan as build
from tests.builders import a_mark
from tests.effort import examples
from tests.powershell_lint.tree import calls_of, parse, plan_of, structure
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


def test_scripts_need_no_plan() -> None:
    part, plan = rendered_plan()
    on = HostSteps(**{each.name: getattr(part, each.name) for each in fields(HostSteps)})
    run = RunIdentity(**{each.name: getattr(plan, each.name) for each in fields(RunIdentity)})

    assert render_scripts(on, run) == render_scripts(part, plan)


def test_a_script_knows_its_undo_by_its_bytes() -> None:
    on, plan = rendered_plan()
    scripts = render_scripts(on, plan)

    digest = hashlib.sha256(scripts[script_name(on, undo=True)]).hexdigest()

    assert f"UndoDigest = '{digest}'" in steps_of(scripts[script_name(on)])
    assert f"Undo = '{script_name(on, undo=True)}'" in steps_of(scripts[script_name(on)])


def test_both_forms_share_head_plan_and_end() -> None:
    # A file that holds the module says in its head, too, why the functions do not ask.
    on, plan = rendered_plan()
    texts = {
        form: {name: text.decode("ascii") for name, text in render_scripts(on, plan, form=form).items()}
        for form in ScriptForm
    }

    for name in texts[ScriptForm.MODULE]:
        module, single = (re.sub("[0-9a-f]{64}", "", texts[form][name]) for form in ScriptForm)
        cut = r"(?ms)^#region The module.*?^#endregion|^\[Diagnostics.CodeAnalysis.*?\)\]\r\n"
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


NAMES = ("arm", "o'hare", "Zo\u00eb", "count")
"""Partitions alike; what a hostile plan file could call them."""

APPLY, UNDO = "onboard.ps1", "onboard.undo.ps1"


def creation(name: str) -> Change:
    return build.create(marked(replace(build.partition(build.settings(name, running=False)), id="")))


def changed(name: str, number: int) -> Change:
    old, new = (build.partition(build.settings(name, reserve=reserve)) for reserve in (70, 40 - number))
    change = build.update(old, marked(new))
    return replace(change, address=replace(change.address, machine=f"id-of-{number}"))


CHANGES = {
    "made": [creation(name) for name in NAMES],
    "changed": [changed(name, number) for number, name in enumerate(NAMES)],
}


def scripts_of(changes: list[Change]) -> dict[str, str]:
    return {name: text.decode("ascii") for name, text in render_scripts(*rendered_plan(changes)).items()}


def test_a_table_stands_where_it_is_shorter_alone() -> None:
    few = scripts_of(CHANGES["changed"][:1])[APPLY]

    assert "$rows" not in few


def test_table_without_banner_says_its_steps() -> None:
    def lines(*actions: str) -> list[str]:
        blocks = (
            PlanBlock(
                owner=f"part-{at}",
                reason="",
                action=action,
                place="",
                is_first=False,
                statements=tuple(
                    StepText(action=f"'{action}'", same={}, before={}, after={}, calls=(f"Stop-VM -Name 'part-{at}'",))
                    for _ in range(3)
                ),
            )
            for at, action in enumerate(actions)
        )
        return list(plan_lines(blocks))

    assert lines(*["stop it"] * 6)[0].startswith("    # === part-0 and 5 more: stop it =")
    assert lines(*map(str, range(6)))[0].startswith("    # === part-0 and 5 more: with the values of each row =")


RISK = "    2 machines added, 3 changed, 2 stopped, 1 removed; 0 disks deleted; task classes: 2 changed, 0 removed.\r\n"
UNDO_RISK = (
    "    0 machines added, 4 changed, 3 stopped, 2 removed; 1 disk deleted; task classes: 1 changed, 1 removed.\r\n"
)
SCRIPTS = {name: text.decode("ascii") for name, text in render_scripts(*rendered_plan()).items()}


def blocks_of(plan: Node, parameter: str) -> list[Node]:
    """The blocks that the calls of a plan are given under this name."""
    return [block for call in calls_of(plan) for name, block in call.given.items() if name == parameter and block]


def test_a_changed_reserve_stops_removes_and_deletes_nothing() -> None:
    (change, *_) = all_changes()
    scripts = render_scripts(*rendered_plan([change]))

    for script in scripts.values():
        text = script.decode("ascii")
        assert "    0 machines added, 1 changed, 0 stopped, 0 removed; 0 disks deleted.\r\n" in text
        assert "    Only these calls change something, with their numbers: Set-VMProcessor 1, Write-Mark 1.\r\n" in text
    there, back = (re.search(r"reserve (\S+) -> (\S+) LP", text.decode("ascii")) for text in scripts.values())
    assert there
    assert back
    assert there.groups() == back.groups()[::-1]


def test_undo_says_machine_is_not_made_again() -> None:
    there, back = (
        [line for line in SCRIPTS[name].split("\r\n") if "Not undone: " in line]
        for name in ("onboard.ps1", "onboard.undo.ps1")
    )

    assert there == back
    assert any("the partition cannot be created again" in line for line in there)


def test_everything_is_counted_and_undo_counts_other_way() -> None:
    assert RISK in SCRIPTS["onboard.ps1"]
    assert UNDO_RISK in SCRIPTS["onboard.undo.ps1"]


def test_guests_script_counts_task_classes_and_no_machines() -> None:
    head = SCRIPTS["onboard.guest.speech.ps1"].partition(".PARAMETER")[0]

    assert "    task classes: 1 changed, 0 removed; no machine is stopped or changed.\r\n" in head
    assert "    speech/task/SpeechRecognition  record it as managed" in head
    assert "    Time: a few seconds for each call. The script waits for no guest.\r\n" in head


def test_head_says_waits_and_downtime() -> None:
    head = [re.split("  +", line.strip()) for line in SCRIPTS["onboard.ps1"].partition("#>")[0].split("\r\n")]
    offs = {row[0]: row[2] for row in head if len(row) == 3}

    assert offs == {
        "name": "off",
        "former": "for good, after at most 120 s",
        "speech": "until it has started, at most 120 s to stop",
    }
    (waits,) = (line for (line, *_) in head if line.startswith("Time: "))
    assert "The script waits at most 240 s while guests stop" in waits
    (at_the_end,) = re.findall(r"at most (\d+) s at the end", waits)
    assert f"$settled = [DateTime]::UtcNow.AddMilliseconds({at_the_end}000)" in shipped_module()["Rarms.psm1"]


def test_undo_starts_only_removed_machines_that_ran() -> None:
    undo = SCRIPTS["onboard.undo.ps1"]
    rows = [line.strip() for line in undo.partition(".PARAMETER")[0].split("\r\n")]

    assert [row.partition("  ")[2].strip() for row in rows if row.startswith("former ")] == [
        "started, if the run ended before the machine was removed"
    ]
    assert not any(f"{name} = " in undo for name in HOST_FACT_NAMES)


def test_unrestorable_parts_are_said_by_machine() -> None:
    removals = [build.delete(build.partition(build.settings(name))) for name in ("part-2", "part-10")]
    (lost,) = (
        line for line in render_scripts(*rendered_plan(removals))["onboard.ps1"].split(b"\r\n") if b"Not un" in line
    )

    assert lost.strip() == b"Not undone: part-2, part-10: the partition cannot be created again"


def test_new_machine_is_a_table_line() -> None:
    head = SCRIPTS["onboard.ps1"].partition("#>")[0].split("\r\n")
    titles = next(at for at, line in enumerate(head) if line.startswith("    machine "))

    names = ["machine", "processors", "reserve", "weight", "memory", "disk", "switch", "secure boot", "start"]
    assert re.split("  +", head[titles].strip()) == names
    rows = [re.split("  +", line.strip()) for line in head[titles + 1 : titles + 3]]
    assert [len(row) for row in rows] == [len(names)] * 2
    assert all(re.fullmatch(r"[0-9.]+ LP \([0-9]+ % of each\)", row[2]) for row in rows)
    assert "    machine " not in SCRIPTS["onboard.undo.ps1"]


def test_head_says_digests_of_undo_and_module() -> None:
    undo = hashlib.sha256(SCRIPTS["onboard.undo.ps1"].encode("ascii")).hexdigest()

    head = SCRIPTS["onboard.ps1"].partition("#>")[0]

    assert f"SHA-256: the undo {undo}, Rarms.psm1 {module_digests()['Rarms.psm1']}." in head


@pytest.mark.parametrize("name", sorted(SCRIPTS))
def test_every_call_of_steps_stands_in_head(name: str) -> None:
    (line,) = (line for line in SCRIPTS[name].split("\r\n") if "Only these calls change something" in line)
    told = {word.split()[0] for word in line.partition(": ")[2].rstrip(".").split(", ")}

    plan = parse(plan_of(SCRIPTS[name]))
    called = {call.name.rpartition("\\")[2] for block in blocks_of(plan, "Set") for call in calls_of(block)}
    assert told == called - {"Test-Open", "Get-VMHardDiskDrive"}, "these two only look"


def script(*, reserve: int = 40, plan: str = "0123456789ab", more: bool = False) -> ScriptSteps:
    old, new = build.partition(build.settings(reserve=70)), build.partition(build.settings(reserve=reserve))
    made = build.create(marked(replace(build.partition(build.settings("planning")), id="")))
    on, whole = rendered_plan((build.update(old, marked(new)), *([made] if more else [])))
    return ScriptSteps(plan=plan, steps=script_steps(on, replace(whole, id=plan), "", undo=False))


def compared(old: ScriptSteps, new: ScriptSteps) -> ScriptDifference:
    return compare_steps(old, new, ("a", "b"))


def test_same_steps_of_another_plan_do_not_differ() -> None:
    found = compared(script(more=True), script(more=True, plan="ba9876543210"))

    assert (found.steps, found.same) == ((), len(script(more=True).steps))


def test_changed_step_names_readings_and_calls() -> None:
    (step,) = compared(script(reserve=40), script(reserve=30)).steps

    assert (step.address, step.old, step.new, step.moved) == ("partition/vision", 1, 1, False)
    reading, call = step.details
    assert reading == Detail(name="after.reserve", old="40", new="30")
    assert call.name == "Hyper-V\\Set-VMProcessor"
    assert call.new is not None
    assert "-Reserve 30 " in call.new


def test_steps_that_only_one_has() -> None:
    added, gone = compared(script(), script(more=True)), compared(script(more=True), script())

    assert {step.address for step in added.steps} == {"partition/planning", "partition/planning/disk"}
    assert all(step.old is None for step in added.steps)
    assert [step.action for step in gone.steps] == [step.action for step in added.steps]
    assert all(step.new is None for step in gone.steps)
    assert added.same == gone.same == len(script().steps)


def test_moved_step_is_told_once() -> None:
    old = script(more=True)
    first, *others = old.steps

    (moved,) = compared(old, replace(old, steps=(*others, first))).steps

    assert (moved.moved, moved.old, moved.new, moved.details) == (True, 1, len(others) + 1, ())
