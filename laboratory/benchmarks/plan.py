"""`rarms plan` of 1,000 components on hosts that are as wanted: the whole command, start-up and all."""

import io
import sys
import tempfile
from contextlib import redirect_stderr, redirect_stdout
from pathlib import Path

from laboratory.benchmarks.timing import Figure, command, consumed, report, seconds
from rarms_iac.cli.main import main as rarms
from rarms_iac.storage import disk
from tests.crashing import CrashingDisk
from tests.fleet import manifest

COMPONENTS = 1_000
ROUNDS = 5
SECONDS = 1.0
MIB = 150.0


def applied(folder: Path) -> str:
    """The path of the manifest, which is applied; nothing is flushed, since no power will fail."""
    path = folder / "rarms.yaml"
    path.write_text(manifest(COMPONENTS), encoding="utf-8", newline="\n")
    said = io.StringIO()
    with redirect_stdout(said), redirect_stderr(said), disk.use(CrashingDisk(0)):
        code = rarms(["apply", "-f", str(path), "--auto-approve"])
    if code != 0:
        raise RuntimeError(said.getvalue()[-2000:])
    return str(path)


def main() -> int:
    with tempfile.TemporaryDirectory() as folder:
        path = applied(Path(folder))
        plan = command([sys.executable, "-m", "rarms_iac", "plan", "-f", path])  # exit code 0: nothing to change
        took = min(seconds(plan) for _ in range(ROUNDS))
        _, memory = consumed(Path(folder), "plan", "-f", path)
    return report(
        [
            Figure(name="rarms plan without changes, 1,000 components", value=took, unit="s", at_most=SECONDS),
            Figure(name="its memory", value=memory, unit="MiB", at_most=MIB),
        ]
    )


if __name__ == "__main__":
    sys.exit(main())
