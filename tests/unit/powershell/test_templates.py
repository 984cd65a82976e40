"""What is fixed in scripts: the runtime, and the parts that a script carries only where its steps need them."""

import pytest

from rarms_iac.powershell.inspection.layout import split_script, without_fixed
from rarms_iac.powershell.render import render_scripts
from rarms_iac.powershell.templates import PARTS, part_begin, part_end, part_text, parts_for, runtime
from rarms_iac.powershell.tree import ShapeNode
from tests.unit.powershell.plans import all_changes, rendered_plan, shape

SCRIPTS = {name: text.decode("ascii") for name, text in render_scripts(*rendered_plan()).items()}
scripts = pytest.mark.parametrize("name", sorted(SCRIPTS))


def carried(script: str) -> tuple[str, ...]:
    return tuple(piece.name for piece in split_script(script).fixed if piece.name)


def statements(script: str) -> list[ShapeNode]:
    """The tree below the list of all statements; between two of them a remark hangs elsewhere than at an end."""
    return [leaf for leaf in shape(script) if leaf.depth > 1 and leaf.label != "comment"]


def test_the_runtime_can_be_read_in_one_sitting() -> None:
    assert runtime().count("\n") <= 355
    assert max(map(len, runtime().split("\n"))) <= 120
    assert all(part_text(name).count("\n") <= 170 for name in PARTS)


@pytest.mark.parametrize("name", PARTS)
def test_a_part_is_its_functions_between_two_lines_that_name_it(name: str) -> None:
    first, *_, before, last = part_text(name).split("\n")

    assert first.startswith(part_begin(name))
    assert last.startswith(part_end(name))
    assert before == "}"  # of a function: nothing on the next line goes on with it


def test_a_script_that_changes_a_reserve_carries_no_more_than_that_needs() -> None:
    (change, *_) = all_changes()
    on, plan = rendered_plan([change])

    (script, undo) = (text.decode("ascii") for _, text in sorted(render_scripts(on, plan).items()))

    assert carried(script) == ("lock", "journal", "preview", "host", "machines")
    assert carried(undo) == ("lock", "journal", "preview", "host", "machines", "capacity")  # there the reserve grows


def test_a_guest_s_script_knows_nothing_of_hyper_v() -> None:
    script = SCRIPTS["onboard.guest.speech.ps1"]

    assert carried(script) == ("lock", "journal", "preview", "guest", "tasks")
    assert "Hyper-V\\" not in script


def test_names_in_texts_and_remarks_are_no_calls() -> None:
    texts = "Write-Mark -Name 'Test-Capacity'  # Get-TaskClassReading"
    assert parts_for(texts) == ("lock", "journal", "preview", "machines")
    assert parts_for("$x = 5") == ("lock", "journal", "preview")  # what the runtime itself calls


def test_a_part_brings_those_that_it_needs() -> None:
    assert parts_for("Test-Capacity -Name 'x'") == ("lock", "journal", "preview", "machines", "capacity")
    assert parts_for("Save-TaskRecord -Task 'x'") == ("lock", "journal", "preview", "tasks", "unseen")


@scripts
def test_the_tree_of_a_script_is_the_trees_of_its_pieces_one_after_another(name: str) -> None:
    whole = SCRIPTS[name]
    parts = split_script(whole)
    pieces = [parts.plan, *(piece.text for piece in parts.fixed), parts.end]

    assert statements(whole) == [leaf for piece in pieces for leaf in statements(piece.replace("\n", "\r\n"))]


@scripts
def test_without_what_is_fixed_every_line_keeps_its_number(name: str) -> None:
    whole, left = SCRIPTS[name].split("\r\n"), without_fixed(SCRIPTS[name]).split("\r\n")

    assert len(left) == len(whole)
    assert {(line, other) for line, other in zip(whole, left, strict=True) if line != other and other} == set()
    assert left[split_script(SCRIPTS[name]).fixed[-1].last] == "Invoke-Run -Steps { Add-Plan }"


def test_what_was_changed_is_looked_at_whole() -> None:
    script = SCRIPTS["onboard.ps1"]
    for edited in (
        script.replace("function Unlock-Host", "function Exit-Hosts"),
        "Get-Item -LiteralPath 'x'\r\n" + script,
    ):
        assert without_fixed(edited) == edited
