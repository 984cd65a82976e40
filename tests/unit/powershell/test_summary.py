"""What the head of a script says of it: counted in the very calls of its steps."""

import hashlib
import re

import pytest
from tree_sitter import Node

from rarms_iac.powershell.render import render_scripts
from rarms_iac.powershell.templates import HOST_FACT_NAMES, module_digests, shipped_module
from tests import builders_plan as build
from tests.powershell_lint.tree import calls_of, parse, plan_of
from tests.unit.powershell.plans import all_changes, rendered_plan

RISK = "    2 machines added, 3 changed, 2 stopped, 1 removed; nothing deleted; task classes: 2 changed, 0 removed.\r\n"
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
        assert "    0 machines added, 1 changed, 0 stopped, 0 removed; nothing deleted.\r\n" in text
        assert "    Only these calls change something (and how often): Set-VMProcessor 1, Write-Mark 1.\r\n" in text
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
    assert any("the machine is not made again" in line for line in there)


def test_everything_is_counted_and_undo_counts_other_way() -> None:
    assert RISK in SCRIPTS["onboard.ps1"]
    assert UNDO_RISK in SCRIPTS["onboard.undo.ps1"]


def test_guests_script_counts_task_classes_and_no_machines() -> None:
    head = SCRIPTS["onboard.guest.speech.ps1"].partition(".PARAMETER")[0]

    assert "    task classes: 1 changed, 0 removed; no machine is stopped or changed.\r\n" in head
    assert "    speech/task/SpeechRecognition  record that it is ours" in head
    assert "    Time: some seconds a call. It waits for no guest.\r\n" in head


def test_head_says_waits_and_downtime() -> None:
    head = [re.split("  +", line.strip()) for line in SCRIPTS["onboard.ps1"].partition("#>")[0].split("\r\n")]
    offs = {row[0]: row[2] for row in head if len(row) == 3}

    assert offs == {
        "name": "off",
        "former": "for good, after 120 s at most",
        "speech": "until it has started, 120 s at most to stop",
    }
    (waits,) = (line for (line, *_) in head if line.startswith("Time: "))
    assert "It waits 240 s at most while guests stop" in waits
    (at_the_end,) = re.findall(r"(\d+) s at most at the end", waits)
    assert f"$settled = [DateTime]::UtcNow.AddMilliseconds({at_the_end}000)" in shipped_module()["Rarms.psm1"]


def test_undo_starts_only_removed_machines_that_ran() -> None:
    undo = SCRIPTS["onboard.undo.ps1"]
    rows = [line.strip() for line in undo.partition(".PARAMETER")[0].split("\r\n")]

    assert [row.partition("  ")[2].strip() for row in rows if row.startswith("former ")] == [
        "started, if the run ended before it was removed"
    ]
    assert not any(f"{name} = " in undo for name in HOST_FACT_NAMES)


def test_unrestorable_parts_are_said_by_machine() -> None:
    removals = [build.delete(build.partition(build.settings(name))) for name in ("part-2", "part-10")]
    (lost,) = (
        line for line in render_scripts(*rendered_plan(removals))["onboard.ps1"].split(b"\r\n") if b"Not un" in line
    )

    assert lost.strip() == b"Not undone: part-2, part-10: the machine is not made again"


def test_new_machine_is_a_table_line() -> None:
    head = SCRIPTS["onboard.ps1"].partition("#>")[0].split("\r\n")
    titles = next(at for at, line in enumerate(head) if line.startswith("    machine "))

    names = ["machine", "processors", "reserve", "memory", "disk", "switch", "secure boot", "start"]
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
