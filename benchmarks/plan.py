"""`rarms plan` of 1,000 components on hosts that are as wanted: the whole command, start-up and all."""

import io
import os
import subprocess
import sys
import tempfile
from contextlib import redirect_stderr, redirect_stdout
from pathlib import Path

from benchmarks.fleet import manifest
from benchmarks.timing import Figure, report, seconds
from rarms_iac.cli.main import main as rarms
from rarms_iac.storage import disk
from tests.crashing import CrashingDisk

COMPONENTS = 1_000
ROUNDS = 5
SECONDS = 1.0
MIB = 150.0


def applied(folder: Path) -> None:
    """The manifest and its hosts, all applied; nothing is flushed, since no power will fail."""
    (folder / "rarms.yaml").write_text(manifest(COMPONENTS), encoding="utf-8", newline="\n")
    said = io.StringIO()
    with redirect_stdout(said), redirect_stderr(said), disk.use(CrashingDisk(0)):
        code = rarms(["apply", "-f", str(folder / "rarms.yaml"), "--auto-approve"])
    if code != 0:
        raise RuntimeError(said.getvalue()[-2000:])


def plan(folder: Path) -> None:
    """One run of the command; it must find nothing to change."""
    words = [sys.executable, "-m", "rarms_iac.cli.main", "plan", "-f", str(folder / "rarms.yaml")]
    done = subprocess.run(words, stdin=subprocess.DEVNULL, stdout=subprocess.DEVNULL, check=False)
    if done.returncode != 0:
        raise RuntimeError(f"rarms plan ended with exit code {done.returncode}")


def most_memory(folder: Path) -> float:
    """The peak of one run's resident memory in MiB, as the system counted it."""
    script = "import resource, sys; from rarms_iac.cli.main import main; code = main(sys.argv[1:]); sys.stderr.write("
    script += "str(resource.getrusage(resource.RUSAGE_SELF).ru_maxrss)); sys.exit(code)"
    words = [sys.executable, "-c", script, "plan", "-f", str(folder / "rarms.yaml")]
    done = subprocess.run(words, stdin=subprocess.DEVNULL, capture_output=True, text=True, check=True)
    return int(done.stderr) / 1024


def main() -> int:
    with tempfile.TemporaryDirectory() as made:
        folder = Path(made)
        applied(folder)
        took = min(seconds(lambda: plan(folder)) for _ in range(ROUNDS))
        figures = [
            Figure(name="rarms plan without changes, 1,000 components", value=took, unit="s", at_most=SECONDS),
        ]
        if os.name == "posix":
            figures.append(Figure(name="its memory", value=most_memory(folder), unit="MiB", at_most=MIB))
    return report(figures)


if __name__ == "__main__":
    sys.exit(main())
