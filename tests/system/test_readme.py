"""What the README shows is what the commands print."""

import os
import re
from contextlib import chdir
from pathlib import Path
from unittest.mock import patch

import pytest

from tests.unit.cli.running import rarms

ROOT = Path(__file__).parents[2]
PLAN = re.compile(r"plan [0-9a-f]{12}")  # it holds the day
FINDINGS = re.compile(r"(?:note|warning)\[.*?\n\n(?=Plan: )", re.DOTALL)  # behind the totals


@pytest.mark.sample
def test_the_plan_in_the_readme_is_what_rarms_prints(tmp_path: Path) -> None:
    readme = (ROOT / "README.md").read_text(encoding="utf-8")
    (shown,) = re.findall(r"\$ rarms plan[^\n]*\n(.*?)```", readme, re.DOTALL)
    robot = (ROOT / "manifests" / "delivery-robot" / "rarms.yaml").read_text(encoding="utf-8")

    with chdir(tmp_path):
        Path("rarms.yaml").write_text(robot, encoding="utf-8", newline="\n")
        measured = rarms("measure")
        applied = rarms("apply", "--auto-approve")
        selected = rarms("select", "face-detection", "--at", "170 ms")
        with patch.dict(os.environ, {"COLUMNS": "80"}):
            planned = rarms("plan")

    assert (measured.code, applied.code, selected.code, planned.code) == (0, 0, 0, 0)
    assert PLAN.sub("plan", FINDINGS.sub("", planned.out)) == PLAN.sub("plan", shown)
