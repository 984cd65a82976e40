"""Machines alike stand as rows of a table; `tests/fake_powershell` runs such scripts."""

from dataclasses import replace

from rarms_iac.model.changes import Change
from rarms_iac.powershell.render import render_scripts
from rarms_iac.powershell.rows import PlanBlock, plan_lines
from rarms_iac.powershell.templates import StepText
from tests import builders_plan as build
from tests.unit.powershell.plans import marked, rendered_plan

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

    assert lines(*["stop it"] * 6)[0].startswith("    # === part-0 and 5 more alike: stop it =")
    assert lines(*map(str, range(6)))[0].startswith("    # === part-0 and 5 more alike: as each row says =")
