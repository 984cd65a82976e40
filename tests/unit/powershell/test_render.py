import hashlib
import re
from dataclasses import replace

import pytest

from rarms_iac.model.changes import Adopt, Change
from rarms_iac.model.moves import BETWEEN
from rarms_iac.powershell.literals import NoLiteral
from rarms_iac.powershell.render import render_apply, render_observe, render_scripts, render_undo, script_name
from rarms_iac.powershell.templates import fill, part_text, runtime
from rarms_iac.providers.marks import mark_for, write_mark
from tests import builders_plan as build
from tests.unit.powershell.hostile import hostile_texts
from tests.unit.powershell.plans import all_changes, marked, rendered_plan, same_structure


def steps_of(script: bytes) -> str:
    """The head and the plan, with LF."""
    return script.decode("ascii").replace("\r\n", "\n").partition("# --- runtime")[0]


def renamed(change: Change, name: str, message: str) -> Change:
    """The same change of a machine with this name, for this reason: names of unmanaged machines may be anything."""
    reason = build.because(message)
    match change.kind:
        case "adopt" | "release" | "create" | "update" | "delete":
            return replace(change, reason=reason, address=replace(change.address, machine=name))
        case _:
            raise AssertionError(change.kind)


def test_one_script_and_its_undo_for_each_operating_system() -> None:
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

    digest = hashlib.sha256(render_undo(on, plan)).hexdigest()

    assert f"UndoDigest = '{digest}'" in steps_of(render_apply(on, plan))
    assert f"Undo = '{script_name(on, undo=True)}'" in steps_of(render_apply(on, plan))


def test_every_script_carries_the_same_runtime() -> None:
    parts = {
        script.decode("ascii").count(runtime().replace("\n", "\r\n"))
        for script in render_scripts(*rendered_plan()).values()
    }

    assert parts == {1}


def test_a_reserve_is_one_readable_call_under_the_banner_of_its_partition() -> None:
    (change, *_) = all_changes()

    text = steps_of(render_apply(*rendered_plan([change])))

    assert re.search(r"\n    # === vision: the manifest wants it \(rarms\.yaml:31:5\) =+\n", text)
    assert (
        "-Action 'reserve 70 -> 40 %, weight 100 -> 200; mark it as robot/vision, set aaaaaaaaaaaa' -Before @{" in text
    )
    assert "limit = 100; mark = 'robot/vision'; reserve = 70; set = '" in text
    call = "        Hyper-V\\Set-VMProcessor -VM $script:Vm -Reserve 40 -Maximum 100 -RelativeWeight 200\n"
    assert f"-Set {{\n{call}        Write-Mark\n    }}\n" in text


def test_a_mark_alone_is_one_line() -> None:
    (adoption,) = (change for change in all_changes() if isinstance(change, Adopt))

    (line,) = (line for line in steps_of(render_apply(*rendered_plan([adoption]))).split("\n") if "Write-Mark" in line)

    assert line.startswith("    Add-Step -Action 'mark it as robot/kiosk, set aaaaaaaaaaaa' -Before @{ ")
    assert line.endswith("-After @{ mark = 'robot/kiosk'; set = 'aaaaaaaaaaaa' } -Set { Write-Mark }")


def test_making_a_machine_is_four_guarded_steps() -> None:
    new = build.create(marked(replace(build.partition(build.settings("planning")), id="")))

    text = steps_of(render_apply(*rendered_plan([new])))

    assert calls_in(text) == ["Hyper-V\\New-VM", "Hyper-V\\New-VHD", "Add-PartitionDisk", "Hyper-V\\Start-VM"]
    (settings,) = re.findall(r"-Set \{\n((?:        .+\n){5,})    \}", text)
    assert re.findall(r"^ +([\w\\-]+)", settings, re.MULTILINE) == [
        "Add-PartitionDisk",
        "Hyper-V\\Set-VMMemory",
        "Clear-NetworkAdapter",
        "Hyper-V\\Set-VMFirmware",
        "Write-Mark",
        "Hyper-V\\Set-VMProcessor",
        "Hyper-V\\Set-VM",
        "Hyper-V\\Rename-VM",
    ]
    assert "-Name (Get-PendingName -Name 'planning')" in text
    assert "Hyper-V\\Set-VMMemory -VM $script:Vm -DynamicMemoryEnabled $false -StartupBytes 536870912\n" in text
    assert "exists = $false; taken = $false" in text
    asked = "-Fits { Test-Capacity -Processors 2 -Reserve 40 -Memory 536870912 }"
    assert text.count(asked) == text.count("-Fits") == 1


def calls_in(plan: str) -> list[str]:
    """The first call of each `Set` block."""
    return re.findall(r"-Set \{\s+([\w\\-]+)", plan)


def test_a_child_of_an_older_disk_has_its_parents_format() -> None:
    new = build.create(marked(replace(build.partition(build.settings("planning")), id="")))

    text = steps_of(render_apply(*rendered_plan([new], image="D:\\images\\old.VHD")))

    assert "-Name 'planning' -Type 'vhd') -ParentPath 'D:\\images\\old.VHD' -Differencing\n" in text


def test_the_undo_goes_backwards_and_only_over_what_was_begun() -> None:
    new = build.create(marked(replace(build.partition(build.settings("planning")), id="")))

    text = steps_of(render_undo(*rendered_plan([new])))

    assert calls_in(text) == ["Invoke-PartitionStop", "Hyper-V\\Remove-VM", "Clear-DiskFile"]
    assert re.findall(r"-Undoes (\d+)", text) == ["3", "0", "0"]
    actions = [action.split(" that")[0] for action in re.findall(r"-Action '([^']+)'", text)]
    assert actions == ["stop it", "remove the machine", "delete the disk"]


def test_a_task_class_is_written_value_by_value_with_types() -> None:
    text = steps_of(render_apply(*rendered_plan()))

    assert "Write-TaskValue -Task 'MotionControl' -Name 'Priority' -Type 'DWord' -Value 5\n" in text
    assert "Write-TaskValue -Task 'MotionControl' -Name 'Scheduling Category' -Type 'String' -Value 'Medium'\n" in text
    assert "Write-TaskRecord -Task 'MotionControl' -Application 'robot' -Digest 'bbbbbbbbbbbb' -Before 'null'" in text


def test_nothing_that_a_value_says_changes_the_structure() -> None:
    harmless = all_changes()[5]
    template = render_apply(*rendered_plan([renamed(harmless, "x", "y")])).decode("ascii")

    for text in hostile_texts(40, seed=23):
        named = renamed(harmless, f"a{text}", text or "because")
        script = render_apply(*rendered_plan([named])).decode("ascii")
        assert same_structure(template, script)


def test_half_a_character_has_no_literal() -> None:
    with pytest.raises(NoLiteral):
        render_apply(*rendered_plan([renamed(all_changes()[5], "\ud800", "why")]))


def test_a_template_that_asks_for_more_fails() -> None:
    from jinja2 import UndefinedError

    with pytest.raises(UndefinedError):
        fill("script.ps1.j2", {"requirements": [], "name": "", "plan": [], "fixed": []})


def test_the_observe_script_has_no_values() -> None:
    assert render_observe() == render_observe()
    assert b"#Requires -Version 5.1\r\n" in render_observe()
    assert render_observe().count(b"#Requires") == 1


def test_the_runtime_reads_every_mark_that_rarms_writes_also_while_two_partitions_exchange_names() -> None:
    form = re.search(r"\$form = '(?P<form>[^']+)'", part_text("machines"))
    assert form is not None
    name_form = re.search(r"\$name = '(?P<name>[^']+)'", part_text("machines"))
    assert name_form is not None
    pattern = re.compile(form["form"].replace("NAME", name_form["name"]).replace("(?<", "(?P<"))

    for name in ("vision", "vision" + BETWEEN):
        mark = mark_for("0a1b2c3d-0000", "robot", name, "0123456789ab")
        written = write_mark("my notes\r\n", mark).replace("\n", "\r\n").split("\n")
        (found,) = filter(None, map(pattern.search, written))
        assert found.groupdict() == {"app": "robot", "name": name, "vm": "0a1b2c3d", "set": "0123456789ab"}
