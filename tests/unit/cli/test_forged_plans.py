"""A plan file that somebody edited and sealed anew: its seal has no key, so its scripts are rendered again."""

import json
from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest

from rarms_iac.storage.digest import digest
from rarms_iac.storage.shipped import shipped
from tests.unit.cli.running import rarms

CELL = shipped("manifests/hyperv-cell")
Forgery = Callable[[dict[str, Any]], None]


@pytest.fixture(scope="module")
def sealed(tmp_path_factory: pytest.TempPathFactory) -> bytes:
    """The plan of the example: a host's script, and those of two guests that nobody looked into."""
    path = tmp_path_factory.mktemp("cell") / "cell.plan"
    assert rarms("plan", "-f", str(CELL), "--snapshot", f"cell={CELL / 'host.json'}", "--out", str(path)).code == 2
    return path.read_bytes()


def forged(sealed: bytes, forgery: Forgery) -> bytes:
    """The plan as the forgery leaves it, with a seal that fits."""
    document = json.loads(sealed)
    del document["seal"]
    forgery(document)
    return json.dumps({**document, "seal": digest(document)}).encode()


def a_line_in(script: str) -> Forgery:
    """One call more, before the script's first step."""

    def forge(document: dict[str, Any]) -> None:
        scripts = document["hosts"][0]["scripts"]
        assert "\r\n    Use-Target" in scripts[script]
        scripts[script] = scripts[script].replace("\r\n    Use-Target", "\r\n    Restart-Computer\r\n    Use-Target", 1)

    return forge


def another_value(document: dict[str, Any]) -> None:
    """A value that every rule of scripts allows: only the steps say something else."""
    scripts = document["hosts"][0]["scripts"]
    assert "-Reserve 80" in scripts["cell.ps1"]
    scripts["cell.ps1"] = scripts["cell.ps1"].replace("-Reserve 80", "-Reserve 81")


def a_script_more(document: dict[str, Any]) -> None:
    scripts = document["hosts"][0]["scripts"]
    scripts["cell.guest.stranger.ps1"] = scripts["cell.ps1"]


def no_undo(document: dict[str, Any]) -> None:
    del document["hosts"][0]["scripts"]["cell.undo.ps1"]


@pytest.mark.parametrize(
    ("forgery", "script"),
    [
        (a_line_in("cell.ps1"), "cell.ps1"),
        (a_line_in("cell.undo.ps1"), "cell.undo.ps1"),
        (a_line_in("cell.guest.seam-tracking.ps1"), "cell.guest.seam-tracking.ps1"),
        (a_line_in("cell.guest.torch-motion.undo.ps1"), "cell.guest.torch-motion.undo.ps1"),
        (another_value, "cell.ps1"),
        (a_script_more, "cell.guest.stranger.ps1"),
        (no_undo, "cell.undo.ps1"),
    ],
)
@pytest.mark.parametrize("command", [("apply",), ("show",), ("show", "--script")])
def test_a_script_that_its_steps_do_not_make_is_refused(
    sealed: bytes, tmp_path: Path, command: tuple[str, ...], forgery: Forgery, script: str
) -> None:
    plan = tmp_path / "forged.plan"
    plan.write_bytes(forged(sealed, forgery))

    ran = rarms(*command, str(plan))

    assert ran.code == 3
    assert "error[RARMS180]" in ran.err
    assert f"its script {script} is not what its steps make" in " ".join(ran.err.split())


@pytest.mark.parametrize("command", [("apply",), ("show",), ("show", "--script")])
def test_a_plan_of_another_version_is_refused_as_that(sealed: bytes, tmp_path: Path, command: tuple[str, ...]) -> None:
    plan = tmp_path / "old.plan"
    plan.write_bytes(forged(sealed, lambda document: document.update(rarms_version="0.0.9")))

    ran = rarms(*command, str(plan))

    assert ran.code == 3
    assert "error[RARMS188]" in ran.err
    assert 'rarms "0.0.9" made it' in " ".join(ran.err.split())


def test_a_plan_that_nobody_forged_is_shown_also_when_git_changed_its_line_ends(sealed: bytes, tmp_path: Path) -> None:
    plan = tmp_path / "good.plan"
    plan.write_bytes(forged(sealed, lambda _: None).replace(b"\n", b"\r\n"))

    assert rarms("show", str(plan)).code == 0
