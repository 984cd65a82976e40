"""What `rarms measure` says and `rarms apply` sets up holds in `rarms prove` against the same load."""

import json
from contextlib import chdir
from pathlib import Path
from random import Random

from tests.effort import examples
from tests.unit.cli.running import rarms

WRONG = 0.1
"""What may be wrong of all verdicts: that of the measurement, and that of the proof; each declares less than half."""

MEAN = "mean_response_time"

KEPT = """\
schema: rarms/v1
application: {{ name: robot }}
policy: {{ interference: busy-loop }}
hosts:
  onboard: {{ logical_processors: {lps}, memory: 8 GiB, keep_for_host: {{ processor: {kept} %, memory: 1 GiB }} }}
components:
"""

COMPONENT = """\
  {name}:
    criticality: {criticality}
    apt: {{ {index}: {{ at_most: {limit} ms }} }}
    memory: 256 MiB
    cpu: {{ reserve: measured }}
    simulation: {{ work: {work} ms, blocked: {blocked} ms, varies: {varies} %, threads: {threads} }}
"""


def a_system(random: Random) -> str:
    """Up to three components that ask for less than the host has, on a host that keeps some of it."""
    lps = random.choice([1, 2, 2, 3])
    text = KEPT.format(lps=lps, kept=random.choice([0, 30, 60]))
    for number in range(random.randint(1, 3)):
        work, blocked = random.randint(8, 60), random.choice([0, 0, 20])
        threads = random.choice([1, 1, lps])
        limit = round(blocked + work / threads * random.uniform(4, 12))
        text += COMPONENT.format(
            name=f"c{number}",
            criticality=number,
            index=random.choice([MEAN, "p95_response_time"]),
            limit=limit,
            work=work,
            blocked=blocked,
            varies=random.choice([0, 5, 20]),
            threads=threads,
        )
    return text


def proven(folder: Path, text: str) -> list[str]:
    """The verdict on each index; none where nothing is promised: it does not fit, or `plan` refuses an index."""
    folder.mkdir()
    (folder / "rarms.yaml").write_text(text, encoding="utf-8", newline="\n")
    with chdir(folder):
        measured = rarms("measure", "--samples", "300")
        assert measured.code in (0, 4), measured.err
        applied = rarms("apply", "--auto-approve")
        assert applied.code in (0, 4), applied.err
        if measured.code or applied.code:
            return []
        proof = rarms("prove", "--load-host", "--samples", "600", "--json")
    return [each["verdict"] for host in json.loads(proof.out)["proofs"] for each in host["verdicts"]]


def test_what_was_measured_and_applied_holds_beside_load(tmp_path: Path) -> None:
    random = Random(15)
    verdicts = [
        verdict for number in range(examples(6)) for verdict in proven(tmp_path / f"robot-{number}", a_system(random))
    ]

    assert len(verdicts) >= examples(6)
    assert verdicts.count("missed") <= WRONG * len(verdicts)


def test_measured_reservation_is_enough_in_service(tmp_path: Path) -> None:
    """Kept time that no partition reserved went to P1: it was said to need 1 %, and took 49 s in service."""
    text = KEPT.format(lps=2, kept=60) + COMPONENT.format(
        name="vision", criticality=1, index=MEAN, limit=60, work=20, blocked=0, varies=5, threads=1
    )

    assert proven(tmp_path / "robot", text) == ["met"]
