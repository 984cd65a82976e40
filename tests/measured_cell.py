"""A small cell with one file of every kind that rarms reads: measured, tuned, planned, applied, proven."""

from contextlib import chdir
from pathlib import Path

from rarms_iac.views.finding_forms import OutputFormat
from tests.effort import LONG
from tests.unit.cli.running import rarms
from tests.unit.manifest.examples import EVERYTHING

MANIFEST = """\
schema: rarms/v1

application: { name: cell }
policy: { interference: busy-loop }

hosts:
  onboard: { logical_processors: 2, memory: 4 GiB }

components:
  vision:
    criticality: 30
    apt: { mean_response_time: { at_most: 41 ms } }
    memory: 512 MiB
    processors: 2
    cpu: { reserve: measured }
    simulation: { work: 20 ms, varies: 2 % }

  paths:
    criticality: 20
    apt: { mean_response_time: { at_most: 65 ms } }
    memory: 512 MiB
    processors: 2
    cpu: { reserve: measured }
    simulation: { work: 20 ms, varies: 2 % }

  video:
    criticality: 10
    apt: { mean_response_time: { at_most: 75 ms } }
    memory: 512 MiB
    processors: 2
    cpu: { reserve: measured }
    simulation: { work: 20 ms, varies: 2 % }
"""
OVERLAY = "application: { description: laid over }\ncomponents: { vision: { criticality: 31, memory: 512 MiB } }\n"

MEASURED = "measurements/onboard"
HOST = ".rarms/hosts/onboard.json"
JOURNAL = ".rarms/hosts/onboard.journal.jsonl"
DATA_LOG = f"{MEASURED}/paths/busy-loop.jsonl"
COMPOUND_LOG = f"{MEASURED}/paths+video/busy-loop.jsonl"
CONFIGURATION_LOG = f"{MEASURED}/paths.configuration.jsonl"
TUNING_LOG = f"{MEASURED}/tuning.jsonl"
PLAN, SNAPSHOT = "plan.json", "snapshot.json"
EVERYTHING_FILE = "everything.yaml"

PROOF: list[list[str]] = [["prove", "--load-host"]] if LONG else []
"""A proof takes seconds where what it reads is no fault: the usual run has it for the host alone."""

READERS: dict[str, list[list[str]]] = {
    "rarms.yaml": [
        *(["validate", "--output", form] for form in OutputFormat),
        *([command] for command in ("plan", "fmt", "measure", "status", "graph", "explain", "doctor", "tune")),
        *PROOF,
        ["plan", "--output", "markdown"],
        ["report", "--out", "report.html"],
    ],
    EVERYTHING_FILE: [["validate", EVERYTHING_FILE, "--output", form] for form in OutputFormat],
    "overlay.yaml": [
        *(["validate", "--overlay", "overlay.yaml", "--output", form] for form in OutputFormat),
        ["plan", "--overlay", "overlay.yaml"],
        ["report", "--overlay", "overlay.yaml", "--out", "report.html"],
    ],
    HOST: [
        ["plan"],
        ["apply", PLAN],
        ["drift"],
        ["undo", "--auto-approve"],
        ["snapshot", "--out", "new.json"],
        ["prove", "--load-host"],
        ["measure", "vision"],
        ["doctor"],
        ["destroy", "--auto-approve"],
    ],
    JOURNAL: [
        ["plan"],
        ["apply", "--auto-approve"],
        ["apply", PLAN],
        ["drift"],
        ["undo", "--auto-approve"],
        ["history"],
        ["status"],
    ],
    DATA_LOG: [
        ["plan"],
        ["explain", "paths"],
        ["report", "--out", "report.html"],
        ["export", "table.csv"],
        ["export", "samples.csv", "--samples"],
        ["export", "table.xlsx"],
        ["measure"],
        ["select", "paths", "--at", "70 ms"],
        ["tune"],
        ["apply", "--auto-approve"],
        ["graph", "--candidates"],
    ],
    COMPOUND_LOG: [
        ["plan"],
        ["explain", "paths"],
        ["report", "--out", "report.html"],
        ["tune"],
        *PROOF,
    ],
    CONFIGURATION_LOG: [["plan"], ["explain", "paths"], *PROOF, ["report", "--out", "report.html"]],
    TUNING_LOG: [["tune"], ["report", "--out", "report.html"], ["explain", "paths"]],
    PLAN: [["show", PLAN], ["show", PLAN, "--script"], ["apply", PLAN], ["show", PLAN, "--json"]],
    SNAPSHOT: [["plan", "--snapshot", f"onboard={SNAPSHOT}"], ["plan", "--snapshot", SNAPSHOT, "--json"]],
}
"""The commands that read each file."""


def make_cell(folder: Path) -> Path:
    """Make the files of `READERS` in a new folder."""
    folder.mkdir()
    soon = MANIFEST.replace("busy-loop }", "busy-loop, measuring: { setting: 25 s, proof: 1 s } }")
    (folder / "rarms.yaml").write_text(soon, encoding="utf-8", newline="\n")
    (folder / EVERYTHING_FILE).write_text(EVERYTHING, encoding="utf-8", newline="\n")
    (folder / "overlay.yaml").write_text(OVERLAY, encoding="utf-8", newline="\n")
    with chdir(folder):
        for words in (
            ["measure", "--samples", "60"],
            ["tune", "--samples", "60"],
            ["plan", "--out", PLAN],
            ["apply", PLAN],
            ["prove", "--load-host"],
            ["snapshot", "--out", SNAPSHOT],
        ):
            rarms(*words)
    assert not [file for file in READERS if not (folder / file).is_file()]
    return folder
