"""A plan file that a person edited and sealed anew: its seal has no key, so its scripts are rendered again."""

import json
from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest

from rarms_iac.model.plan import Plan
from rarms_iac.storage.codec import decode
from rarms_iac.storage.digest import digest
from rarms_iac.storage.plan_file import plan_id
from rarms_iac.storage.shipped import shipped
from tests.unit.cli.running import rarms

CELL = shipped("manifests/hyperv-cell")
Forgery = Callable[[dict[str, Any]], None]


@pytest.fixture(scope="module")
def sealed(tmp_path_factory: pytest.TempPathFactory) -> bytes:
    """The plan of the example: a host's script, and those of two guests that were not looked into."""
    path = tmp_path_factory.mktemp("cell") / "cell.plan"
    assert rarms("plan", "-f", str(CELL), "--snapshot", f"cell={CELL / 'host.json'}", "--out", str(path)).code == 0
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
    assert "Reserve = 80" in scripts["cell.ps1"]
    scripts["cell.ps1"] = scripts["cell.ps1"].replace("Reserve = 80", "Reserve = 81")


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


def with_its_id(document: dict[str, Any]) -> None:
    """As the forger of anything but a script must: the id is a digest, too."""
    document["id"] = plan_id(decode(Plan, document))


def a_name(change: Forgery) -> Forgery:
    def forge(document: dict[str, Any]) -> None:
        change(document)
        with_its_id(document)

    return forge


def another_host(name: str) -> Forgery:
    return a_name(lambda document: document["hosts"][0]["host"].update(name=name))


def another_guest(document: dict[str, Any]) -> None:
    for task in document["hosts"][0]["guest_tasks"]:
        task["partition"] = "../../guest"


def another_task(document: dict[str, Any]) -> None:
    document["hosts"][0]["guest_tasks"][0]["name"] = "..\\\\Windows"


def another_partition(document: dict[str, Any]) -> None:
    document["hosts"][0]["steps"][0]["operation"]["partition"] = "../motion"


@pytest.mark.parametrize(
    "forgery",
    [
        another_host("../../elsewhere"),
        another_host("caf\u00e9"),
        another_host(""),
        another_host("cell\n"),
        a_name(another_guest),
        a_name(another_task),
        a_name(another_partition),
        a_name(lambda document: document.update(application="../x")),
    ],
)
@pytest.mark.parametrize("command", [("apply",), ("show",), ("show", "--script", "--out", "DIR")])
def test_a_name_that_no_manifest_can_give_is_refused_and_nothing_is_written(
    sealed: bytes, tmp_path: Path, command: tuple[str, ...], forgery: Forgery
) -> None:
    folder = tmp_path / "a" / "b"
    folder.mkdir(parents=True)
    plan = folder / "forged.plan"
    plan.write_bytes(forged(sealed, forgery))

    ran = rarms(*(str(folder / "out") if part == "DIR" else part for part in command), str(plan))

    assert ran.code == 3
    assert "error[RARMS180]" in ran.err
    assert "no manifest can give the name" in " ".join(ran.err.split())
    assert [path for path in tmp_path.rglob("*") if path.is_file()] == [plan]


def binary_value(document: dict[str, Any]) -> None:
    next(iter(document["hosts"][0]["guest_tasks"][0]["values"].values()))["kind"] = "binary"


@pytest.mark.parametrize("command", [("apply",), ("show",), ("show", "--script")])
def test_steps_that_make_no_script_are_refused(sealed: bytes, tmp_path: Path, command: tuple[str, ...]) -> None:
    plan = tmp_path / "forged.plan"
    plan.write_bytes(forged(sealed, a_name(binary_value)))

    ran = rarms(*command, str(plan))

    assert ran.code == 3
    assert "error[RARMS180]" in ran.err
    assert "its script cell.ps1 is not what its steps make" in " ".join(ran.err.split())


@pytest.mark.parametrize("command", [("apply",), ("show",), ("show", "--script")])
def test_a_plan_of_another_version_is_refused_as_that(sealed: bytes, tmp_path: Path, command: tuple[str, ...]) -> None:
    plan = tmp_path / "old.plan"
    plan.write_bytes(forged(sealed, lambda document: document.update(rarms_version="0.0.9")))

    ran = rarms(*command, str(plan))

    assert ran.code == 3
    assert "error[RARMS188]" in ran.err
    assert 'rarms "0.0.9" made it' in " ".join(ran.err.split())


def test_a_plan_that_was_not_forged_is_shown_also_when_git_changed_its_line_ends(sealed: bytes, tmp_path: Path) -> None:
    plan = tmp_path / "good.plan"
    plan.write_bytes(forged(sealed, lambda _: None).replace(b"\n", b"\r\n"))

    assert rarms("show", str(plan)).code == 0
