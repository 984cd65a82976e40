"""Situations of a Hyper-V host as plain files: `rarms.yaml`, `host.json` as observe.ps1 printed it, and what follows.

`COMMAND` is what is asked (`plan`, `destroy`, ...), `plan.txt` what rarms shows, `findings.txt` what it says beside it,
and `*.ps1` are the scripts of the situations in `WITH_SCRIPTS`. `python -m tests.cases.situations` writes the last
three; read the difference before you commit it. The scripts hold the digests of their module: a change of it changes
all of them.
"""

import contextlib
import json
import os
from dataclasses import dataclass
from datetime import date
from functools import cache
from itertools import pairwise
from pathlib import Path
from tempfile import TemporaryDirectory
from unittest.mock import patch

from rarms_iac.app.plan_files import read_plan_file
from rarms_iac.applying.make_plan import make_plan
from rarms_iac.applying.plan_request import PlanRequest
from rarms_iac.manifest.load import load_system
from rarms_iac.model.plan import Plan, Purpose
from rarms_iac.providers.hyperv.parse import to_state
from rarms_iac.views.console import render
from rarms_iac.views.findings_text import findings_text
from rarms_iac.views.plan import plan_text
from tests.fake_powershell.host import WindowsHost
from tests.fake_powershell.observing import host_from
from tests.recorded_hosts import read_observation
from tests.unit.cli.running import rarms

CASES = Path(__file__).parent
TODAY = date(2026, 11, 21)
INPUTS = ("rarms.yaml", "host.json")
WITH_SCRIPTS = frozenset(
    {
        "adopt",
        "create-with-image-and-switch",
        "destroy-with-disks",
        "hostile-names",
        "processors-with-a-stop",
        "rename",
        "reserves-swap",
        "start-with-more",
        "task-class-in-a-guest",
        "task-class-replaces-a-shipped-one",
    }
)
"""The situations whose scripts are kept: each kind of step once."""
ON_POWERSHELL = WITH_SCRIPTS | {
    "create-generation-1",
    "create-linux",
    "memory-live",
    "secure-boot-needs-a-stop",
    "stop-action-needs-a-stop",
    "stopped-stays",
    "task-classes-new",
    "unused",
}
"""The situations that a usual run shows to the real PowerShell: they have each form of call of all of them."""


@dataclass(frozen=True, slots=True)
class Made:
    """What rarms makes of a situation: the plan where there is one, and the files by name."""

    plan: Plan | None
    files: dict[str, bytes]


def folders() -> list[Path]:
    return sorted(path.parent for path in CASES.glob("*/host.json"))


def command_of(folder: Path) -> list[str]:
    return (folder / "COMMAND").read_text(encoding="utf-8").split()


@cache
def made(folder: Path, seen: bytes | None = None) -> Made:
    """The plan and the files; of another observation of the host where one is given. Made once a process."""
    with TemporaryDirectory() as name, contextlib.chdir(name):
        here = Path(name)
        for file in INPUTS:
            (here / file).write_bytes((folder / file).read_bytes())
        if seen is not None:
            (here / "host.json").write_bytes(seen)
        words = command_of(folder)
        plan, texts = _by_command(words) if words[0] == "plan" else _by_library(words)
    if plan is not None and folder.name in WITH_SCRIPTS:
        texts |= plan.hosts[0].scripts
    return Made(plan=plan, files={name: text.encode("utf-8") for name, text in texts.items()})


def _by_command(words: list[str]) -> tuple[Plan | None, dict[str, str]]:
    with patch.dict(os.environ, {"COLUMNS": "80"}):  # a reviewer reads what was made beside the situation
        ran = rarms(*words, "--snapshot", "host.json", "--out", "made.plan", "--today", TODAY.isoformat())
    plan = read_plan_file("made.plan") if Path("made.plan").exists() else None
    return plan, {"plan.txt": ran.out, "findings.txt": f"{ran.err}exit {ran.code}\n"}


def _by_library(words: list[str]) -> tuple[Plan | None, dict[str, str]]:
    """The other commands want the host itself, not what it looked like: the same without a command."""
    loaded = load_system("rarms.yaml", today=TODAY)
    assert loaded.system is not None
    (name,) = loaded.system.hosts
    options = dict(pairwise([*words, ""]))
    request = PlanRequest(
        system=loaded.system,
        places=loaded.places,
        manifest="rarms.yaml",
        manifest_digest=loaded.digest,
        texts=loaded.texts_without_secrets(),
        today=TODAY,
        purpose=Purpose(words[0]),
        targets=(options["--target"],) if "--target" in options else (),
        machine=options.get("--id", ""),
        remove_disks="--remove-disks" in words,
        partitions=tuple(word for word in words[1:2] if not word.startswith("--")),
    )
    prepared = make_plan(request, {name: to_state(read_observation(Path("host.json").read_bytes()), name)})
    shown = render(plan_text(prepared.plan, sources=loaded.sources)) if prepared.plan else ""
    findings = render(findings_text(prepared.findings, loaded.sources, accepted=prepared.accepted))
    return prepared.plan, {"plan.txt": shown, "findings.txt": findings}


def stand_in(folder: Path) -> WindowsHost:
    """The host of the situation, with every image that its manifest names."""
    document = json.loads((folder / "host.json").read_text(encoding="utf-8"))
    words = (folder / "rarms.yaml").read_text(encoding="utf-8").splitlines()
    images = [line.partition("image:")[2].strip().strip("'\"") for line in words if "image:" in line]
    return host_from(document, *(image.replace("''", "'") for image in images))


def outputs(folder: Path) -> dict[str, bytes]:
    """The files that lie there now."""
    inputs = {*INPUTS, "WHY", "COMMAND"}
    return {path.name: path.read_bytes() for path in folder.iterdir() if path.name not in inputs}


if __name__ == "__main__":
    for case in folders():
        fresh = made(case).files
        for gone in outputs(case).keys() - fresh.keys():
            (case / gone).unlink()
        for file, data in fresh.items():
            (case / file).write_bytes(data)
