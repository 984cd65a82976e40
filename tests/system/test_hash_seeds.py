"""The same input gives the same bytes, in whatever order this Python happens to keep its sets."""

import os
import subprocess
import sys
from pathlib import Path

import pytest

from rarms_iac.storage.shipped import shipped
from tests.effort import LONG
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
graph --format dot
snapshot --out .
drift --json
destroy --out second.plan --today 2026-11-21
"""


def all_that_is_said(folder: Path, manifest: bytes, seed: str) -> dict[str, bytes]:
    """What the route's commands print under this seed, and every file they leave but who ran what and when."""
    folder.mkdir()
    (folder / "rarms.yaml").write_bytes(manifest)
    leave_logs(folder, dict.fromkeys(("face-detection", "speech-recognition", "path-planning", "video-streaming"), 20))
    ran = subprocess.run(
        [sys.executable, "-c", SCRIPT],
        input=ROUTE.encode(),
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


@pytest.mark.parametrize("example", ["delivery-robot", "two-hosts", "fleet", "partitions"])
def test_hash_seeds_change_no_byte(tmp_path: Path, example: str) -> None:
    manifest = (shipped("manifests") / example / "rarms.yaml").read_bytes()

    first = all_that_is_said(tmp_path / "0", manifest, SEEDS[0])

    assert "first.plan" in first
    assert b'"hosts"' in first["standard output"]
    for run in range(1, RUNS):
        assert all_that_is_said(tmp_path / str(run), manifest, SEEDS[run % len(SEEDS)]) == first
