"""What `rarms measure` answers beside all loads of the policy, and a sweep beside the same loads, on this Linux.

`python -m laboratory.linux.loads`: a control loop (4.4 ms every 20 ms, 95th percentile at most 12 ms) and a program of
job after job (20 ms, mean at most 45 ms). The sweep writes groups by hand, halves what lies around the answer beside
each load, and takes the highest. Needs root, about seven minutes, and a quiet machine; 1 where an answer is more
than two points from its sweep.
"""

import json
import os
import subprocess
import sys
import tempfile
from collections.abc import Mapping
from datetime import UTC, datetime
from pathlib import Path

from laboratory.linux.experiments import COMPONENT_GROUP, Laboratory, laboratory, meets, series_of, values_of
from laboratory.linux.prediction import PROGRAM, least
from rarms_iac.manifest.load import load
from rarms_iac.model.loads import DEFAULT_LOADS, LOADS_WITHOUT_ENTRY
from rarms_iac.model.system import Component

MANIFEST = """\
schema: rarms/v1
application: {{ name: loads }}
hosts:
  onboard: {{ provider: linux, logical_processors: {processors}, memory: 1 GiB, linux: {{ slice: rarms-loads }} }}
policy: {{ interference: [{loads}], measuring: {{ setting: 40 s }} }}
components:
  control-loop:
    criticality: 20
    apt: {{ p95_response_time: {{ at_most: 12 ms }} }}
    run:
      command: [python3, program.py, "4.4", "0", "1", "20"]
      files: [program.py]
      arrival: {{ every: 20 ms }}
      samples: {{ from: json_lines, response_time: {{ field: ms, unit: ms }} }}
    processors: {processors}
    memory: 64 MiB
  job-after-job:
    criticality: 10
    apt: {{ mean_response_time: {{ at_most: 45 ms }} }}
    run:
      command: [python3, program.py, "20", "0", "1", "0"]
      files: [program.py]
      samples: {{ from: json_lines, response_time: {{ field: ms, unit: ms }} }}
    processors: {processors}
    memory: 64 MiB
"""

SECONDS = 6.0
"""So long a run of the sweep lasts: 300 jobs of the control loop."""

BELOW, ABOVE, HIGHEST = 10, 6, 97
"""So many points around the answer are swept, and no reservation above the last."""

NEAR = 2


def main() -> int:
    """Print a line for each component and load."""
    processors = len(os.sched_getaffinity(0))
    is_near = True
    with tempfile.TemporaryDirectory() as folder:
        robot = Path(folder)
        manifest = MANIFEST.format(processors=processors, loads=", ".join(DEFAULT_LOADS))
        (robot / "rarms.yaml").write_text(manifest, encoding="utf-8")
        (robot / "program.py").write_text(PROGRAM, encoding="utf-8")
        system = load(str(robot / "rarms.yaml"), today=datetime.now(UTC).date()).system
        assert system is not None
        answers = {name: measured(robot, name) for name in system.components}
        with laboratory(robot, os.environ, processors) as machine:
            for name, component in system.components.items():
                is_near &= report(machine, component, answers[name])
    return 0 if is_near else 1


def report(machine: Laboratory, component: Component, answers: Mapping[str, int | None]) -> bool:
    """Print what a component was measured to need beside each load, and what the sweep says; whether they are near."""
    found = [answer for answer in answers.values() if answer is not None]
    if len(found) < len(answers):
        print(f"{component.name}: no answer beside {', '.join(name for name in answers if answers[name] is None)}")
        return False
    swept = {name: sweep(machine, component, name, max(found)) for name in answers}
    for name, reserve in swept.items():
        print(f"{component.name} beside {name}: measured {answers[name]} %, swept {reserve or 'more than was swept'} %")
    most = max(reserve or HIGHEST + 1 for reserve in swept.values())
    print(f"{component.name}: measured {max(found)} %, swept {most} %, {max(found) - most:+d} points", flush=True)
    return abs(max(found) - most) <= NEAR


def measured(robot: Path, name: str) -> dict[str, int | None]:
    """What `rarms measure` answers by load, in per cent of the host; None: nothing."""
    words = (sys.executable, "-m", "rarms_iac", "measure", name, "--json")
    done = subprocess.run(words, cwd=robot, stdout=subprocess.PIPE, text=True, check=False)
    if done.returncode not in (0, 4):
        raise RuntimeError(f"measure {name} ended with {done.returncode}")
    return {each["interference"]: each["planned"] for each in json.loads(done.stdout)["experiments"]}


def sweep(machine: Laboratory, component: Component, name: str, around: int) -> int | None:
    """The least reservation that is enough beside a load, within what is swept, in per cent of the host."""

    def is_enough(reserve: int) -> bool:
        machine.split(reserve, 100 - reserve)
        with machine.load(LOADS_WITHOUT_ENTRY[name], reserve=100.0 - reserve):
            record = machine.run(component, machine.tree.place(COMPONENT_GROUP), SECONDS)
        return meets(component, values_of(component, series_of(component.name, record["series"])))

    return least(max(1, around - BELOW), min(HIGHEST, around + ABOVE), is_enough)


if __name__ == "__main__":
    sys.exit(main())
