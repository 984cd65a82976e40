"""What the README shows is what the commands print."""

import os
import re
from contextlib import chdir
from pathlib import Path
from unittest.mock import patch

import pytest

from tests.robots import applied_delivery_robot
from tests.unit.cli.running import rarms

ROOT = Path(__file__).parents[2]
PLAN = re.compile(r"[Pp]lan [0-9a-f]{12}")  # it holds the day
FINDINGS = re.compile(r"(?:note|warning)\[.*?\n\n(?=Plan: )", re.DOTALL)  # behind the totals


@pytest.mark.sample
def test_plan_in_readme_is_what_rarms_prints(tmp_path: Path) -> None:
    readme = (ROOT / "README.md").read_text(encoding="utf-8")
    (shown,) = re.findall(r"\$ rarms plan[^\n]*\n(.*?)```", readme, re.DOTALL)

    with chdir(applied_delivery_robot(tmp_path)):
        selected = rarms("select", "face-detection", "--at", "170 ms")
        measured = rarms("measure", "face-detection", "--stop-partitions")
        with patch.dict(os.environ, {"COLUMNS": "80"}):
            planned = rarms("plan")

    assert (selected.code, measured.code, planned.code) == (0, 0, 0)
    assert PLAN.sub("plan", FINDINGS.sub("", planned.out)) == PLAN.sub("plan", shown)
