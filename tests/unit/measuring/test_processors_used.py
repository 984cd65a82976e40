"""How many virtual processors a component gets that does not say: as many as it was seen to use at once."""

import json
from contextlib import chdir
from dataclasses import replace
from pathlib import Path

import pytest

from tests.measuring import rewrite_log
from tests.unit.cli.running import rarms

MANIFEST = """\
schema: rarms/v1
application: { name: robot }
hosts:
  onboard: { logical_processors: 4, memory: 4 GiB }
components:
  eyes:
    criticality: 3
    apt: { mean_response_time: { at_most: 50 ms } }
    interference: busy-loop
    run: { command: [eyes], until: { samples: 40 } }
    memory: 256 MiB
    simulation: { work: 20 ms, threads: THREADS }
"""
LOG = Path("measurements/onboard/eyes/busy-loop.jsonl")


@pytest.fixture
def manifest(tmp_path: Path) -> Path:
    path = tmp_path / "rarms.yaml"
    path.write_text(MANIFEST.replace("THREADS", "1"), encoding="utf-8", newline="\n")
    return path


def recorded() -> list[tuple[int, int | None]]:
    """Of each setting of the log its virtual processors, and how many were used at once."""
    lines = [json.loads(line) for line in LOG.read_text(encoding="utf-8").splitlines()]
    return [(line["processors"], line.get("used_processors")) for line in lines if "series" in line]


@pytest.mark.parametrize(("threads", "used"), [(1, 1), (2, 2), (6, 4)])
def test_first_setting_shows_used_processors(threads: int, used: int, manifest: Path) -> None:
    manifest.write_text(MANIFEST.replace("THREADS", str(threads)), encoding="utf-8", newline="\n")
    with chdir(manifest.parent):
        measured = json.loads(rarms("measure", "--json").out)["experiments"][0]
        settings = recorded()
        again = json.loads(rarms("measure", "--json").out)["experiments"][0]
        while again["new"]:  # the first run ended at as many settings as there may be, and the same command goes on
            again = json.loads(rarms("measure", "--json").out)["experiments"][0]
        planned = json.loads(rarms("plan", "--json").out)

    assert settings[0] == (4, used)
    assert {processors for processors, _ in settings[1:]} == {used}
    assert (measured["processors"], measured["processors_from"]) == (used, "used")
    assert again["processors"] == used
    assert again["reserve"] <= measured["reserve"]
    assert f'"processors": {used}' in json.dumps(planned)


def test_fixed_processors_stay_and_are_noted(manifest: Path) -> None:
    fixed = manifest.read_text(encoding="utf-8").replace("    memory", "    processors: 2\n    memory")
    with chdir(manifest.parent):
        manifest.write_text(fixed, encoding="utf-8", newline="\n")
        ran = rarms("measure")
        settings = recorded()
        manifest.write_text(MANIFEST.replace("THREADS", "1"), encoding="utf-8", newline="\n")
        left_open = json.loads(rarms("measure", "--json").out)["experiments"][0]

    assert "RARMS380" in ran.err
    assert set(settings) == {(2, 1)}
    assert left_open["processors"] == 1


def test_papers_strategy_keeps_the_hosts_number(manifest: Path) -> None:
    with chdir(manifest.parent):
        measured = json.loads(rarms("measure", "--strategy", "paper", "--json").out)["experiments"][0]
        settings = recorded()
        planned = rarms("explain", "eyes").out

    assert (measured["processors"], measured["processors_from"]) == (4, "host")
    assert set(settings) == {(4, None)}
    assert "4 virtual processors as many as the host has" in " ".join(planned.split())


def test_later_growth_is_measured_with_more_processors(manifest: Path) -> None:
    """The program is the same for rarms: a log that holds says 1, and now 2 threads run at once."""
    with chdir(manifest.parent):
        rarms("measure")
        before = recorded()
        manifest.write_text(MANIFEST.replace("THREADS", "2"), encoding="utf-8", newline="\n")
        lines = LOG.read_text(encoding="utf-8")
        rarms("measure")  # stale: measured again, of two threads
        after = recorded()

    assert before[0] == (4, 1)
    assert '"threads"' not in lines.splitlines()[0]
    assert after[: len(before)] == before
    assert after[len(before)] == (4, 2)


def test_growing_use_begins_a_new_curve(
    manifest: Path,
) -> None:
    """What a log says was seen of two threads is one processor: the next setting shows two."""
    manifest.write_text(MANIFEST.replace("THREADS", "2"), encoding="utf-8", newline="\n")
    with chdir(manifest.parent):
        rarms("measure", "--from", "40%", "--to", "40%")
        rewrite_log(LOG, lambda each: replace(each, setting=replace(each.setting, processors=1, used_processors=1)))
        ran = rarms("measure")
        seen = recorded()

    assert ran.err.count("eyes beside busy-loop on onboard (simulated): 1 to 8 settings") == 2
    assert "RARMS380" in ran.err
    assert {processors for processors, used in seen if used == 2} == {1, 2}
    of_two = [processors for processors, _ in seen if processors == 2]
    assert len(of_two) <= 8
