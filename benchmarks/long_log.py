"""`rarms explain` and `rarms report` with a data log of 1,000,000 samples: processor time and memory."""

import random
import sys
import tempfile
from array import array
from collections.abc import Iterator
from pathlib import Path

from benchmarks.timing import Figure, consumed, report
from rarms_iac.model.series import SampleColumns, Series
from rarms_iac.model.setting import Setting
from rarms_iac.storage.datalog.files import append_setting, log_path, read_log
from rarms_iac.storage.datalog.log import Recorded

MANIFEST = """\
schema: rarms/v1
application: { name: cell }
hosts:
  onboard: { logical_processors: 2, memory: 4 GiB }
components:
  vision:
    criticality: 30
    apt: { mean_response_time: { at_most: 41 ms } }
    memory: 512 MiB
    cpu: { reserve: measured }
    simulation: { work: 20 ms }
"""
COMMANDS = (("explain", "vision"), ("report", "--out", "report.html"))
SAMPLES = 1_000_000
SETTINGS = 10
ROUNDS = 3
SECONDS = 2.0
MIB = 200.0


def series(reserve: int, dice: random.Random) -> Series:
    """Jobs one after the other, whose response times depend on their neighbours."""
    count, level, drift, clock = SAMPLES // SETTINGS, 2000 / reserve, 0.0, 0.0
    began, times = array("d"), array("d")
    for _ in range(count):
        drift = 0.5 * drift + dice.gauss(0.0, 0.02 * level)
        began.append(clock)
        times.append(level + drift)
        clock += times[-1]
    samples = SampleColumns(
        began_ms=began, response_ms=times, successful=b"\1" * count, counts=array("d", [1.0]) * count, failures={}
    )
    return Series(component="vision", samples=samples, elapsed_ms=clock, cpu_ms=20.0 * count)


def make_cell(folder: Path) -> None:
    """Make a manifest with a measured log, and make the log long."""
    (folder / "rarms.yaml").write_text(MANIFEST, encoding="utf-8", newline="\n")
    consumed(folder, "measure", "--samples", "60", "--from", "50%", "--to", "50%")
    path = log_path(folder, "onboard", ["vision"], "busy-loop")
    log = read_log(path)
    assert log is not None, "it was measured"
    (header,), (_, measured) = log.headers.values(), log.recorded[0]
    dice = random.Random(1)
    for reserve in range(100 // SETTINGS, 101, 100 // SETTINGS):
        setting = Setting(reserve=reserve, series=(series(reserve, dice),), beside=100 - reserve, seed=1)
        append_setting(path, header, Recorded(setting=setting, provenance=measured.provenance))


def figures(folder: Path) -> Iterator[Figure]:
    for words in COMMANDS:
        times, peaks = zip(*(consumed(folder, *words) for _ in range(ROUNDS)), strict=True)
        name = f"rarms {words[0]}, a log of 1,000,000 samples"
        yield Figure(name=name, value=min(times), unit="s", at_most=SECONDS)
        yield Figure(name="its memory", value=max(peaks), unit="MiB", at_most=MIB)


def main() -> int:
    with tempfile.TemporaryDirectory() as made:
        make_cell(Path(made))
        return report(list(figures(Path(made))))


if __name__ == "__main__":
    sys.exit(main())
