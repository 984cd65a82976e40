"""The same input gives the same bytes, in any order in which a Python keeps its sets."""

import os
import re
import subprocess
import sys
from pathlib import Path

import pytest

from rarms_iac.storage.shipped import shipped
from tests.effort import LONG
from tests.files import copy_files
from tests.measuring import leave_logs

SEEDS = ("0", "1", "4242")
RUNS = 100 if LONG else len(SEEDS)
SCRIPT = """
import sys
from rarms_iac.cli.main import main

for line in sys.stdin.read().splitlines():
    main(line.split())
"""
ROUTE = """\
validate --json
schema manifest
plan --out first.plan --today 2026-11-21
plan --json --today 2026-11-21
show first.plan
apply first.plan --today 2026-11-21
graph
snapshot --out .
drift --json
destroy --out second.plan
"""
MEASURE = "measure --json"
TUNE = """\
export before.xlsx
explain path-following
tune --json
validate --json
plan --out first.plan --today 2026-11-21
explain path-following
graph --candidates
report
export after.csv
"""
INSTANT = re.compile(rb"\d{4}-\d\d-\d\dT\d\d:\d\d:\d\d(?:\.\d+)?Z( to \S+Z)?|(?<=\"checksum\":\")[0-9a-f]{64}")
"""When something was measured, and the checksum of a record that says so: an input of its own."""


def all_that_is_said(folder: Path, manifest: bytes, seed: str) -> dict[str, bytes]:
    """What the route's commands print under this seed, and every file they leave but who ran what and when."""
    folder.mkdir()
    (folder / "rarms.yaml").write_bytes(manifest)
    leave_logs(folder, dict.fromkeys(("face-detection", "speech-recognition", "path-planning", "video-streaming"), 20))
    return all_that_is_left(folder, ROUTE, seed)


def all_that_is_left(folder: Path, route: str, seed: str) -> dict[str, bytes]:
    """What these commands print in the folder, and every file that then is there but journals and locks."""
    ran = subprocess.run(
        [sys.executable, "-c", SCRIPT],
        input=route.encode(),
        cwd=folder,
        env={**os.environ, "PYTHONHASHSEED": seed},
        capture_output=True,
        timeout=120,
    )
    assert ran.returncode == 0, ran.stderr.decode()
    written = {
        path.relative_to(folder).as_posix(): path.read_bytes()
        for path in folder.rglob("*")
        if path.is_file() and not path.name.endswith((".journal.jsonl", ".lock"))
    }
    return {"standard output": ran.stdout, **written}


@pytest.mark.parametrize("example", ["delivery-robot", "two-hosts", *(["fleet", "partitions"] if LONG else [])])
def test_hash_seeds_change_no_byte(tmp_path: Path, example: str) -> None:
    manifest = (shipped("manifests") / example / "rarms.yaml").read_bytes()

    first = all_that_is_said(tmp_path / "0", manifest, SEEDS[0])

    assert "first.plan" in first
    assert b'"hosts"' in first["standard output"]
    for run in range(1, RUNS):
        assert all_that_is_said(tmp_path / str(run), manifest, SEEDS[run % len(SEEDS)]) == first


def test_hash_seeds_do_not_change_tuning(tmp_path: Path) -> None:
    """What the measured components of a robot give: its layout, and what is drawn and written of them."""
    measured = tmp_path / "measured"
    measured.mkdir()
    (measured / "rarms.yaml").write_bytes((shipped("manifests") / "over-full" / "rarms.yaml").read_bytes())
    all_that_is_left(measured, MEASURE, SEEDS[0])

    first = all_that_is_tuned(tmp_path / "0", measured, SEEDS[0])

    assert {"before.xlsx", "after.csv", "report.html", "first.plan"} <= set(first)
    for run in range(1, RUNS):
        assert all_that_is_tuned(tmp_path / str(run), measured, SEEDS[run % len(SEEDS)]) == first


def all_that_is_tuned(folder: Path, measured: Path, seed: str) -> dict[str, bytes]:
    left = all_that_is_left(copy_files(measured, folder), TUNE, seed)
    return {name: INSTANT.sub(b"", content) for name, content in left.items()}
