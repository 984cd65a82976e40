"""Components of one thread on a host of four processors: what `rarms measure` says of it, and where it does not fit."""

from contextlib import chdir
from pathlib import Path

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
    assert planned.code == 2


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
