import random
from collections.abc import Mapping

import pytest

from rarms_iac.powershell.inspection.allowed import ScriptKind
from rarms_iac.powershell.inspection.inspect import inspect
from rarms_iac.powershell.render import render_observe, render_scripts
from tests.builders import codes
from tests.effort import LONG
from tests.unit.powershell.mutations import CHANGING, DANGEROUS, READING, Mutation
from tests.unit.powershell.plans import rendered_plan

SCRIPTS = dict(render_scripts(*rendered_plan()))
EACH = 12 if LONG else 2  # of each operator: more than a thousand in the long run


def kind_of(name: str) -> ScriptKind:
    return ScriptKind.UNDO if ".undo." in name else ScriptKind.APPLY


def missed(operators: Mapping[str, Mutation], script: bytes, kind: ScriptKind, each: int) -> tuple[list[str], int]:
    """The mutants that pass the inspection, and how many were tried."""
    pick = random.Random(5)
    text = script.decode("ascii")
    passed: list[str] = []
    tried = 0
    for name, operator in operators.items():
        for _ in range(each):
            mutant = operator(text, pick)
            if mutant is None or mutant == text:
                continue
            tried += 1
            if not inspect(mutant.encode("utf-8"), kind):
                passed.append(f"{name}: {difference(text, mutant)}")
    return passed, tried


def difference(text: str, mutant: str) -> str:
    at = next((at for at, (old, new) in enumerate(zip(text, mutant, strict=False)) if old != new), len(text))
    return repr(mutant[max(0, at - 40) : at + 60])


@pytest.mark.parametrize("name", sorted(SCRIPTS))
def test_what_rarms_renders_passes(name: str) -> None:
    assert inspect(SCRIPTS[name], kind_of(name), name) == ()


def test_the_observe_script_passes_and_only_as_one_that_reads() -> None:
    assert inspect(render_observe(), ScriptKind.OBSERVE) == ()
    assert codes(inspect(render_observe(), ScriptKind.APPLY))


def test_a_script_that_changes_is_no_read_only_one() -> None:
    assert "RARMS210" in codes(inspect(SCRIPTS["onboard.ps1"], ScriptKind.OBSERVE))


def test_mutants_of_an_apply_script_are_caught() -> None:
    passed, tried = missed(DANGEROUS | CHANGING, SCRIPTS["onboard.ps1"], ScriptKind.APPLY, EACH)

    assert passed == []
    assert tried > 40 * EACH


def test_mutants_of_an_undo_script_are_caught() -> None:
    passed, tried = missed(CHANGING, SCRIPTS["onboard.undo.ps1"], ScriptKind.UNDO, EACH)

    assert passed == []
    assert tried > 9 * EACH


def test_mutants_of_the_observe_script_are_caught() -> None:
    passed, tried = missed(DANGEROUS | READING, render_observe(), ScriptKind.OBSERVE, EACH)

    assert passed == []
    assert tried > 25 * EACH
