"""The advice of a measurement agrees with itself: a user who follows it comes to a result."""

import json
import random
import re
from pathlib import Path

import pytest

from tests.unit.cli.running import rarms

MANIFEST = """\
schema: rarms/v1
application: { name: law }
hosts: { onboard: { logical_processors: 1, memory: 4 GiB } }
components:
  vision:
    criticality: 1
    apt: { mean_response_time: { at_most: LIMIT ms } }
    memory: 256 MiB
    simulation: { work: 5 ms, varies: VARIES % }
policy: { interference: [busy-loop], measuring: { setting: SETTING } }
"""
MORE_TIME = re.compile(r"setting: (\d+) min")


@pytest.mark.parametrize("seed", [0, 1, 3, 4])
def test_more_time_as_advised_gives_a_result(seed: int, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """RARMS111 on thresholds just above what the whole host gives: it ends, and never advises what was there."""
    monkeypatch.chdir(tmp_path)
    chance = random.Random(seed)
    manifest = MANIFEST.replace("LIMIT", f"{5 * chance.uniform(1.015, 1.04):.3f}").replace(
        "VARIES", str(chance.choice([30, 50]))
    )
    seconds, setting, measured = 12, "12 s", {}
    for _ in range(4):
        Path("rarms.yaml").write_text(manifest.replace("SETTING", setting), encoding="utf-8")
        measured = json.loads(rarms("measure", "--json").out)
        findings = [each for each in measured["findings"] if each["code"] == "RARMS111"]
        if not findings:
            break
        advised = MORE_TIME.search(findings[0]["advice"])
        assert advised, findings[0]["advice"]
        assert 60 * int(advised[1]) > seconds, "more than there was"
        seconds, setting = 60 * int(advised[1]), f"{advised[1]} min"
    assert seconds > 12, "the first budget is too small"
    assert [each["ending"] for each in measured["experiments"]] == ["found"]
