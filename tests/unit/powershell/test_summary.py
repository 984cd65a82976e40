"""What the head of a script says of it: counted in the very calls of its steps."""

import pytest

from rarms_iac.powershell.outline import outline
from rarms_iac.powershell.render import render_scripts
from tests.unit.powershell.plans import all_changes, rendered_plan

SCRIPTS = {name: text.decode("ascii") for name, text in render_scripts(*rendered_plan()).items()}


def test_a_changed_reserve_stops_removes_and_deletes_nothing() -> None:
    (change, *_) = all_changes()
    scripts = render_scripts(*rendered_plan([change]))

    for script in scripts.values():
        text = script.decode("ascii")
        assert "    0 machines added, 1 changed, 0 stopped, 0 removed; nothing deleted.\r\n" in text
        assert "    Calls that change something: Set-VMProcessor 1, Write-Mark 1.\r\n" in text


def test_everything_is_counted_and_the_undo_counts_the_other_way() -> None:
    assert "    2 machines added, 3 changed, 2 stopped, 1 removed; nothing deleted.\r\n" in SCRIPTS["onboard.ps1"]
    assert "    0 machines added, 4 changed, 3 stopped, 2 removed; 1 disk deleted.\r\n" in SCRIPTS["onboard.undo.ps1"]


@pytest.mark.parametrize("name", sorted(SCRIPTS))
def test_every_call_of_the_steps_stands_in_the_head(name: str) -> None:
    (line,) = (line for line in SCRIPTS[name].split("\r\n") if "Calls that change something" in line)
    told = {word.split()[0] for word in line.partition(": ")[2].rstrip(".").split(", ")}

    steps = outline(SCRIPTS[name].encode("ascii")).steps

    assert told == {call.name.rpartition("\\")[2] for step in steps for call in step.calls}
