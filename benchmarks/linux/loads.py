"""What `rarms measure` answers with all loads of the policy, and a sweep with the same loads, on this Linux.

`python -m benchmarks.linux.loads [COMPONENT...]`: the four components of the Linux delivery robot, whose policy is a
busy loop, and three programs with the default's loads: a control loop (4.4 ms every 20 ms, 95th percentile at most 12
ms), job after job (20 ms, mean at most 45 ms), and two threads (20 ms, mean at most 30 ms). The sweep writes groups by
hand, halves what lies around the answer with each load, and takes the highest. Needs root, what
`scripts/make-robot` needs, and a quiet machine, on which it takes about 30 minutes. Exit code 1: an answer is more than
two points and more than 5 % from its sweep, or other programs used more than 2 % of the machine.
"""

import json
import os
import resource
import subprocess
import sys
import tempfile
import time
from collections.abc import Mapping
from datetime import UTC, datetime
from pathlib import Path

from benchmarks.linux.evaluation import PRIORITIES
from benchmarks.linux.experiments import Workbench, meets, percent_of_host, series_of, values_of, workbench
from benchmarks.linux.prediction import PROGRAM, least
from rarms_iac.manifest.load import load_system
from rarms_iac.model.loads import DEFAULT_LOADS, LOADS_WITHOUT_ENTRY
from rarms_iac.model.system import Component

CHECKOUT = Path(__file__).parents[2]

BUDGET = "policy: { measuring: { setting: 2 min } }\n"
"""Where all loads together had 40 s for a setting, job after job was measured 5 points above its sweep."""

MANIFEST = """\
schema: rarms/v1
application: {{ name: loads }}
hosts:
  onboard: {{ provider: linux, logical_processors: {processors}, memory: 1 GiB, linux: {{ slice: rarms-loads }} }}
policy: {{ interference: [{loads}] }}
components:
"""

COMPONENT = """\
  {name}:
    criticality: 10
    apt: {{ {apt} }}
    run:
      command: [python3, program.py, {words}]
      files: [program.py]
      arrival: {arrival}
      samples: {{ from: json_lines, response_time: {{ field: ms, unit: ms }} }}
    processors: {processors}
    memory: 64 MiB
"""

PROGRAMS = (
    ("control-loop", "p95_response_time: { at_most: 12 ms }", '"4.4", "0", "1", "20"', "{ every: 20 ms }"),
    ("job-after-job", "mean_response_time: { at_most: 45 ms }", '"20", "0", "1", "0"', "closed"),
    ("two-threads", "mean_response_time: { at_most: 30 ms }", '"20", "0", "2", "0"', "closed"),
)
"""Name, threshold, words of the program, arrival."""

SECONDS = 6.0
"""So long a run of the sweep lasts: 300 jobs of the control loop."""

BELOW, ABOVE, HIGHEST = 10, 6, 97
"""So many points around the answer are swept, and no reservation above the last."""

NEAR = 2
"""Points of the host; 5 % of the sweep's answer is near too."""

OTHER_WORK = 2.0
"""Per cent of the machine's time: with more than that used by other programs, a run does not count."""


def main() -> int:
    """Print a line for each component and load."""
    processors = len(os.sched_getaffinity(0))
    own = f"{CHECKOUT / '.cache/robot/bin'}:{Path(sys.executable).parent}"
    environment = {**os.environ, "PATH": f"{own}:{os.environ['PATH']}"}
    chosen = frozenset(sys.argv[1:])
    is_near, other = True, OtherWork()
    with tempfile.TemporaryDirectory() as folder:
        robots = [make_programs(Path(folder) / "programs", processors)]
        if not chosen or chosen - {name for name, *_ in PROGRAMS}:
            robots.append(make_robot(Path(folder) / "robot"))
        for robot in robots:
            system = load_system(str(robot / "rarms.yaml"), today=datetime.now(UTC).date()).system
            assert system is not None
            names = [name for name in system.components if name in chosen or not chosen]
            answers = {name: measured(robot, environment, name) for name in names}
            with workbench(robot, environment, processors) as machine:
                for name in names:
                    is_near &= report(machine, system.components[name], answers[name])
    share = other.percent(processors)
    print(f"Other work on the machine: {share:.1f} %; a run with more than {OTHER_WORK:g} % does not count")
    return 0 if is_near and share <= OTHER_WORK else 1


class OtherWork:
    """The processor time that programs use that are not this process's or its children's, from here on."""

    def __init__(self) -> None:
        self._begun = time.monotonic(), busy_seconds(), own_seconds()

    def percent(self, processors: int) -> float:
        """Return the share of the machine's time that they used; children count when they have ended."""
        began, busy, own = self._begun
        return 100 * (busy_seconds() - busy - (own_seconds() - own)) / (time.monotonic() - began) / processors


def busy_seconds() -> float:
    """Return the processor time that this machine has used since it started."""
    user, nice, system, _idle, _waiting, irq, soft, *_ = map(
        int, Path("/proc/stat").read_text(encoding="ascii").splitlines()[0].split()[1:]
    )
    return (user + nice + system + irq + soft) / os.sysconf("SC_CLK_TCK")


def own_seconds() -> float:
    """Return the processor time of this process and of its children that have ended."""
    return sum(
        used.ru_utime + used.ru_stime
        for used in map(resource.getrusage, (resource.RUSAGE_SELF, resource.RUSAGE_CHILDREN))
    )


def make_robot(folder: Path) -> Path:
    """Copy the Linux delivery robot there, with what it sees and hears."""
    folder.mkdir()
    subprocess.run((str(CHECKOUT / "scripts/make-robot"), "--as-root", str(folder)), check=True)
    (folder / "budget.yaml").write_text(BUDGET, encoding="utf-8")
    return folder


def make_programs(folder: Path, processors: int) -> Path:
    """Write the manifest of the other three there, and their program."""
    folder.mkdir()
    components = (
        COMPONENT.format(name=name, apt=apt, words=words, arrival=arrival, processors=processors)
        for name, apt, words, arrival in PROGRAMS
    )
    manifest = MANIFEST.format(processors=processors, loads=", ".join(DEFAULT_LOADS)) + "".join(components)
    (folder / "rarms.yaml").write_text(manifest, encoding="utf-8")
    (folder / "program.py").write_text(PROGRAM, encoding="utf-8")
    (folder / "budget.yaml").write_text(BUDGET, encoding="utf-8")
    return folder


def report(
    machine: Workbench, component: Component, answers: Mapping[str, float | None], seconds: float = SECONDS
) -> bool:
    """Print what a component was measured to need with each load, and what the sweep says; whether they are near.

    Args:
        seconds: how long a run of the sweep lasts.
    """
    found = [answer for answer in answers.values() if answer is not None]
    if len(found) < len(answers):
        print(f"{component.name}: no answer with {', '.join(name for name in answers if answers[name] is None)}")
        return False
    swept = {name: sweep(machine, component, name, round(max(found)), seconds) for name in answers}
    for name, reserve in swept.items():
        print(f"{component.name} with {name}: measured {answers[name]:g} %, swept {reserve or 'more'} %")
    most = max(reserve or HIGHEST + 1 for reserve in swept.values())
    apart = max(found) - most
    print(f"{component.name}: measured {max(found):g} %, swept {most} %, {apart:+g} points", flush=True)
    return abs(apart) <= max(NEAR, 0.05 * most)


def measured(
    robot: Path, environment: Mapping[str, str], name: str, *, is_quick: bool = False
) -> dict[str, float | None]:
    """Return what `rarms measure` answers by load, in per cent of the host; None: nothing.

    Args:
        is_quick: Whether the answer is that of the first pass.
    """
    words = [sys.executable, "-m", "rarms_iac", "measure", name, "--overlay", "budget.yaml", "--json"]
    words += ["--quick"] if is_quick else []
    done = subprocess.run(words, cwd=robot, env=dict(environment), stdout=subprocess.PIPE, text=True, check=False)
    if done.returncode not in (0, 4):
        raise RuntimeError(f"measure {name} ended with {done.returncode}")
    found = json.loads(done.stdout)["experiments"]
    if is_quick:
        return {
            each["interference"]: 100 * each["provisional_lp"] / each["host_lp"] if each["is_provisional"] else None
            for each in found
        }
    return {each["interference"]: percent_of_host(each) if each["planned"] else None for each in found}


def sweep(machine: Workbench, component: Component, name: str, around: int, seconds: float) -> int | None:
    """Return the least reservation that is enough with a load, within what is swept, in per cent of the host."""
    priority = PRIORITIES[component.name] if component.task_class else None  # another robot may have these names, too

    def is_enough(reserve: int) -> bool:
        record = machine.at_reserve(component, reserve, priority, load=LOADS_WITHOUT_ENTRY[name], seconds=seconds)
        return meets(component, values_of(component, series_of(component.name, record["series"])))

    return least(max(1, around - BELOW), min(HIGHEST, around + ABOVE), is_enough)


if __name__ == "__main__":
    sys.exit(main())
