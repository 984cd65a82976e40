"""How long `rarms` takes to say something, against the bare interpreter of the same environment.

Text for a person pays at most the import of rich, which lays it out; what a program reads does not import it.
"""

import statistics
import sys
import tempfile
from pathlib import Path

from benchmarks.timing import Figure, command, interleaved, median_ratio, report
from tests.robots import fleet_manifest

ROUNDS = 31
RICH = "import rich.console, rich.table, rich.text, rich.segment, rich.cells"


def main() -> int:
    rarms = str(Path(sys.executable).parent / "rarms")
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder, "rarms.yaml")
        path.write_text(fleet_manifest(3), encoding="utf-8", newline="\n")
        times = interleaved(
            {
                "bare": command([sys.executable, "-c", "pass"]),
                "rich": command([sys.executable, "-c", RICH]),
                "version": command([rarms, "--version"]),
                "help": command([rarms, "--help"]),
                "text": command([rarms, "plan", "-f", str(path)], expect=2),
                "json": command([rarms, "plan", "-f", str(path), "--json"], expect=2),
            },
            rounds=ROUNDS,
        )
    bare = times["bare"]
    import_of_rich = statistics.median(rich - alone for rich, alone in zip(times["rich"], bare, strict=True))
    beyond = statistics.median(text - json for text, json in zip(times["text"], times["json"], strict=True))
    return report(
        [
            Figure(name="python -c pass", value=1000 * statistics.median(bare), unit="ms"),
            Figure(name="rarms --version / bare interpreter", value=median_ratio(times["version"], bare), at_most=2),
            Figure(name="rarms --help / bare interpreter", value=median_ratio(times["help"], bare), at_most=10),
            Figure(name="import of rich", value=1000 * import_of_rich, unit="ms"),
            Figure(name="rarms plan: text beyond JSON / import of rich", value=beyond / import_of_rich, at_most=1),
        ]
    )


if __name__ == "__main__":
    sys.exit(main())
