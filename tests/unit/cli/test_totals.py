"""What is reserved and what is free is the same figure in every command."""

import json
import re
from contextlib import chdir
from pathlib import Path

import pytest

from tests.fluid import without_scheduler
from tests.robots import a_measured
from tests.unit.cli.running import rarms

HEAD = "schema: rarms/v1\napplication: { name: robot }\n"
ONE_HOST = "hosts:\n  onboard: { logical_processors: 2, memory: 4 GiB }\n"
KEPT = """\
hosts:
  onboard: { logical_processors: 2, memory: 4 GiB, keep_for_host: { processor: 10 %, memory: 512 MiB } }
"""
TWO_HOSTS = """\
hosts:
  onboard: { logical_processors: 2, memory: 4 GiB, keep_for_host: { processor: 10 % }, platform: cell }
  spare: { logical_processors: 2, memory: 4 GiB, platform: cell }
"""
TWO_PLATFORMS = TWO_HOSTS.replace(", platform: cell", "").replace(
    "spare: { logical_processors: 2", "spare: { logical_processors: 4"
)
CORES = """\
hosts:
  onboard:
    logical_processors: 4
    memory: 4 GiB
    simulated: { smt: true }
"""
VISION = "components:\n" + a_measured(processors=None)
SPEECH = "  speech: { criticality: 1, memory: 256 MiB, cpu: { reserve: 0.5 LP }, processors: 1 }\n"
AT_HOME = SPEECH.replace("speech:", "audio:").replace("processors: 1", "processors: 1, hosts: [onboard]")
BY_HAND = "partitions:\n  speech: { components: [speech], start: manual }\n"

MANIFESTS = {
    "a measured component": ONE_HOST + VISION,
    "a fixed one beside it": ONE_HOST + VISION + SPEECH,
    "something is kept for the host": KEPT + VISION + SPEECH,
    "several that may run on two hosts": TWO_HOSTS + VISION + SPEECH,
    "one that may run on one of two hosts": TWO_HOSTS + VISION + AT_HOME,
    "two platforms": TWO_PLATFORMS + VISION + SPEECH + AT_HOME,
    "components together": ONE_HOST + VISION + SPEECH + AT_HOME + BY_HAND.replace("[speech]", "[speech, audio]"),
    "one that is started by hand": ONE_HOST + VISION + SPEECH + BY_HAND,
    "threads that stand idle": CORES + VISION + SPEECH,
    "a limit": ONE_HOST + VISION + SPEECH.replace("0.5 LP", "0.5 LP, limit: 0.8 LP"),
}


@pytest.mark.parametrize("manifest", MANIFESTS.values(), ids=MANIFESTS)
def test_every_command_counts_what_is_placed(manifest: str, tmp_path: Path) -> None:
    (tmp_path / "rarms.yaml").write_text(HEAD + manifest, encoding="utf-8")
    with chdir(tmp_path), without_scheduler():
        measured = rarms("measure", "--samples", "60", "--on-busy-host")
        text = " ".join(rarms("plan").out.split())
        applied = rarms("apply", "--auto-approve")
        assert applied.code == 0, applied.err
        planned = json.loads(rarms("plan", "--json").out)
        status = json.loads(rarms("status", "--json").out)
        selected = json.loads(rarms("select", "vision", "--at", "50 ms", "--json").out)
        report = json.loads(rarms("report", "--json").out)
        explained = " ".join(rarms("explain", "vision").out.split())
        shown = [measured.out, text, applied.out, *(rarms(name).out for name in ("status", "report", "graph"))]
        shown += [rarms("select", "vision", "--at", "50 ms").out]

    reserved = {host["name"]: host["totals"]["reserved_lp"] for host in planned["hosts"]}
    free = {host["name"]: host["totals"]["free_lp"] for host in status["hosts"]}
    assert sum(reserved.values()) > 0
    assert {host["name"]: host["totals"]["promised"]["reserved_lp"] for host in status["hosts"]} == pytest.approx(
        reserved
    )
    assert {name: host["free_lp"] for name, host in selected["totals"].items()} == pytest.approx(free)
    for capacity in report["capacities"]:
        assert capacity["reserved_lp"] == pytest.approx(sum(reserved[name] for name in capacity["hosts"]))
        assert capacity["headroom_lp"] == pytest.approx(sum(free[name] for name in capacity["hosts"]))
    told = re.findall(r", ([\d.]+) LP free\.", text) + re.findall(r"free on \w+ ([\d.]+) LP", explained)
    assert len(told) >= 2
    assert {float(figure) for figure in told} <= {round(amount, 2) for amount in free.values()}
    wholes = [set(re.findall(r"[\d.]+ LP of ([\d.]+) LP", " ".join(output.split()))) for output in shown]
    sizes = {capacity["processors"] for capacity in report["capacities"]}
    sizes |= {host["host_lp"] for host in selected["totals"].values()}
    assert set().union(*wholes) <= set(map(str, sizes)), "all LPs of a host, or of a platform's hosts"
    assert sum(map(bool, wholes)) >= 5
    planned = re.findall(r"(\w+): ([\d.]+) LP of [\d.]+ LP reserved", measured.out)
    assert {name: float(figure) for name, figure in planned} == {name: round(reserved[name], 2) for name, _ in planned}
    assert planned
