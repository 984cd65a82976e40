"""`rarms plan` of 1,000 components on 50 hosts, the whole command: nothing to change, and then everything."""

import io
import sys
import tempfile
from contextlib import redirect_stderr, redirect_stdout
from pathlib import Path

from benchmarks.timing import Figure, command, consumed, median_ratio, report, seconds
from rarms_iac.cli.main import main as rarms
from rarms_iac.storage import disk
from tests.crashing import CrashingDisk
from tests.robots import fleet_manifest

COMPONENTS = 1_000
ROUNDS = 5
SECONDS = 1.0
MIB = 150.0
TIMES_VALIDATE = 3.0
"""Processor time of a plan, in that of `rarms validate` of the same manifest."""


def applied(folder: Path) -> str:
    """Return the path of the manifest, which is applied; nothing is flushed, since no power will fail."""
    path = folder / "rarms.yaml"
    path.write_text(fleet_manifest(COMPONENTS), encoding="utf-8", newline="\n")
    said = io.StringIO()
    with redirect_stdout(said), redirect_stderr(said), disk.use(CrashingDisk(0)):
        code = rarms(["apply", "-f", str(path), "--auto-approve"])
    if code != 0:
        raise RuntimeError(said.getvalue()[-2000:])
    return str(path)


def untouched(folder: Path) -> str:
    """Return the path of the same manifest, of which nothing is applied."""
    path = folder / "untouched" / "rarms.yaml"
    path.parent.mkdir(exist_ok=True)
    path.write_text(fleet_manifest(COMPONENTS), encoding="utf-8", newline="\n")
    return str(path)


def main() -> int:
    with tempfile.TemporaryDirectory() as folder:
        path = applied(Path(folder))
        plan = command([sys.executable, "-m", "rarms_iac", "plan", "-f", path])  # exit code 0: nothing to change
        took = min(seconds(plan) for _ in range(ROUNDS))
        _, memory = consumed(Path(folder), "plan", "-f", path)
        used: dict[str, list[float]] = {"validate": [], "plan": [], "everything": []}
        for _ in range(ROUNDS):
            used["validate"].append(consumed(Path(folder), "validate", "-f", path)[0])
            used["plan"].append(consumed(Path(folder), "plan", "-f", path)[0])
            words = ("plan", "--detailed-exitcode", "-f", untouched(Path(folder)))
            used["everything"].append(consumed(Path(folder), *words, expect=2)[0])
    return report(
        [
            Figure(name="rarms plan without changes, 1,000 components", value=took, unit="s", at_most=SECONDS),
            Figure(name="its memory", value=memory, unit="MiB", at_most=MIB),
            Figure(
                name="its processor time / validate",
                value=median_ratio(used["plan"], used["validate"]),
                at_most=TIMES_VALIDATE,
            ),
            Figure(
                name="where everything is to be made / validate",
                value=median_ratio(used["everything"], used["validate"]),
                at_most=TIMES_VALIDATE,
            ),
        ]
    )


if __name__ == "__main__":
    sys.exit(main())
