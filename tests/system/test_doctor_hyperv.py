"""`rarms doctor` on what hosts said of themselves: each recorded host with the findings that it is recorded for."""

import json
from pathlib import Path

import pytest

from tests.recorded_hosts import FOLDER, NAMES
from tests.unit.cli.running import rarms

MANIFEST = Path(__file__).parent.parent.parent / "manifests" / "hyperv-cell" / "rarms.yaml"
EXPECTED = {
    "client-with-root-scheduler": ["RARMS126", "RARMS159", "RARMS241", "RARMS405"],
    "duplicates-of-a-name": ["RARMS151", "RARMS234"],
    "empty-host": ["RARMS234"],
    "event-log-rolled-over": ["RARMS166", "RARMS190"],
    "inside-a-guest": ["RARMS126", "RARMS233", "RARMS249"],
    "machines-in-every-state": ["RARMS234", "RARMS245"],
    "redirected-by-windows-powershell": ["RARMS234"],
    "server-2022-with-strangers": ["RARMS234", "RARMS367"],
    "unprivileged-caller": ["RARMS126", "RARMS158", "RARMS166", "RARMS249"],
}


def codes(name: str) -> list[str]:
    ran = rarms("doctor", "-f", str(MANIFEST), "--snapshot", f"cell={FOLDER / name}.json", "--json")
    (host,) = json.loads(ran.out)["hosts"]
    return sorted({finding["code"] for finding in host["findings"]})


@pytest.mark.parametrize("name", NAMES)
def test_recorded_host_is_told_its_problems(name: str) -> None:
    assert codes(name) == EXPECTED[name]
