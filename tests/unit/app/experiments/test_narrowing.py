"""Components of one thread on a host of four processors: what `rarms measure` says of it, and where it does not fit."""

from contextlib import chdir
from pathlib import Path

import pytest

from tests.unit.cli.running import rarms

COMPONENT = """\
  {name}:
    criticality: {criticality}
    apt: {{ mean_response_time: {{ at_most: {limit} ms }} }}
    run: {{ command: [{name}], until: {{ samples: 400 }} }}
    memory: 256 MiB
    simulation: {{ work: 20 ms, threads: 1 }}
"""
MANIFEST = """\
schema: rarms/v1
application: { name: robot }
hosts:
  onboard: { logical_processors: 4, memory: 4 GiB }
components:
""" + "".join(COMPONENT.format(name=name, criticality=at, limit=10 * at) for at, name in ((4, "ears"), (3, "eyes")))


def test_fewer_processors_are_proposed_offered_first_where_it_does_not_fit_and_then_are_enough(tmp_path: Path) -> None:
    manifest = tmp_path / "rarms.yaml"
    manifest.write_text(MANIFEST, encoding="utf-8", newline="\n")
    with chdir(tmp_path):
        wide = rarms("measure")
        refused = rarms("plan")
        narrowed = MANIFEST.replace("    memory: 256 MiB\n", "    memory: 256 MiB\n    processors: 1\n")
        manifest.write_text(narrowed, encoding="utf-8", newline="\n")
        narrow = rarms("measure")
        planned = rarms("plan")

    assert "RARMS268" in wide.err
    assert "`rarms measure eyes --write-processors`" in " ".join(wide.err.split())
    assert refused.code == 4
    ways = " ".join(refused.err.split())
    assert "`processors: 1` for eyes, which uses no more of its 4" in ways
    assert ways.index("Fewer virtual processors may be enough") < ways.index("mean_response_time at most")
    assert "RARMS268" not in narrow.err
    assert planned.code == 0


def test_asked_to_it_writes_fewer_processors_and_measures_again(tmp_path: Path) -> None:
    manifest = tmp_path / "rarms.yaml"
    manifest.write_text(MANIFEST, encoding="utf-8", newline="\n")
    with chdir(tmp_path):
        rarms("measure")
        ran = rarms("measure", "eyes", "--write-processors")
        planned = rarms("plan")

    assert ran.code == 0, ran.err
    assert "`processors: 1` for eyes, which uses no more of its 4. It is measured again." in " ".join(ran.err.split())
    assert "RARMS268" not in ran.err
    assert manifest.read_text(encoding="utf-8").count("processors: 1\n") == 1
    assert "stale" not in planned.err


@pytest.mark.parametrize(("answer", "written", "code"), [("y", 1, 0), ("n", 0, 0), ("q", 0, 0)])
def test_at_a_terminal_it_asks_before_it_writes_and_measures_again(
    answer: str, written: int, code: int, tmp_path: Path
) -> None:
    manifest = tmp_path / "rarms.yaml"
    manifest.write_text(MANIFEST, encoding="utf-8", newline="\n")
    with chdir(tmp_path):
        ran = rarms("measure", "eyes", stdin=f"?\n{answer}\n", at_a_terminal=True)

    said = " ".join(ran.err.split())
    assert "eyes uses no more than 1 of its 4 virtual processors" in said
    assert "Write `processors: 1` into the manifest, and measure it again? [y/N/?/q]" in said
    assert "y writes it, comments kept, and measures how much it needs then" in said
    assert manifest.read_text(encoding="utf-8").count("processors: 1\n") == written
    assert ("It is measured again." in said) == bool(written)
    assert ("RARMS268" in said) == (not written)
    assert ran.code == code


def test_where_a_program_reads_the_answer_no_question_is_asked(tmp_path: Path) -> None:
    (tmp_path / "rarms.yaml").write_text(MANIFEST, encoding="utf-8", newline="\n")
    with chdir(tmp_path):
        ran = rarms("measure", "eyes", "--json", stdin="y\n", at_a_terminal=True)

    assert "[y/N/?/q]" not in ran.err
    assert "RARMS268" in ran.err
