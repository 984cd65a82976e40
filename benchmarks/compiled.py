"""The compiled wheel's scheduler against the same modules in Python: processor time, and whether their jobs are equal.

`python -m benchmarks.compiled [WHEEL [COMPONENTS]]` runs the first COMPONENTS of the draw (40 unless said) next to each
of the default loads. Without WHEEL it builds one first, which needs a C compiler and Python's headers.
"""

import json
import os
import random
import subprocess
import sys
import tempfile
import time
from dataclasses import dataclass
from pathlib import Path
from zipfile import ZipFile

from benchmarks.timing import Figure, report

CHECKOUT = Path(__file__).resolve().parents[1]
SIMULATED_MS = 12_000.0
RESTART_MS = 1_000.0
"""How often the loads begin again."""


@dataclass(frozen=True, slots=True)
class Ran:
    """What one copy of the modules did with each component and load."""

    compiled: bool
    seconds: float  # of processor time
    jobs: dict[str, list[tuple[float, float, bool, float]]]  # when each began, its response and success, time consumed


def build_wheel(folder: Path) -> Path:
    """Build the compiled wheel by way of a source distribution, so that nothing compiled stays in the checkout."""
    words = [sys.executable, "-m", "build", "--outdir", str(folder), str(CHECKOUT)]
    done = subprocess.run(
        words, env={**os.environ, "HATCH_BUILD_HOOK_ENABLE_MYPYC": "1"}, capture_output=True, text=True, check=False
    )
    if done.returncode:
        raise RuntimeError(done.stdout + done.stderr)
    [wheel] = folder.glob("*.whl")
    return wheel


def run_in(package: Path, components: int, simulated_ms: float = SIMULATED_MS) -> Ran:
    """Run the draw in a process of its own, with the package that lies in this folder."""
    environment = {**os.environ, "PYTHONPATH": os.pathsep.join((str(package), str(CHECKOUT))), "PYTHONSAFEPATH": "1"}
    words = [sys.executable, "-m", "benchmarks.compiled", "--run", str(components), str(simulated_ms)]
    done = subprocess.run(words, env=environment, capture_output=True, text=True, check=True)
    compiled, seconds, jobs = json.loads(done.stdout)
    return Ran(compiled, seconds, jobs)


def difference(one: Ran, other: Ran) -> float:
    """Return the largest difference of a time of two runs, in ms; infinite where their jobs differ otherwise."""
    largest = 0.0
    for name, jobs in one.jobs.items():
        others = other.jobs[name]
        if len(jobs) != len(others) or any(a[2] != b[2] for a, b in zip(jobs, others, strict=True)):
            return float("inf")
        for mine, its in zip(jobs, others, strict=True):
            largest = max(largest, *(abs(mine[field] - its[field]) for field in (0, 1, 3)))
    return largest


def _run(components: int, simulated_ms: float) -> None:
    from benchmarks.measuring import LOADS, LongRuns, draw, loaded
    from rarms_iac.providers.simulated.scheduling import simulation

    jobs, seconds = {}, 0.0
    with tempfile.TemporaryDirectory() as folder:
        for seed in range(components):
            drawn = draw(seed)
            hosts = loaded(Path(folder) / drawn.name, drawn.manifest(drawn.used))
            runs = LongRuns(drawn, hosts, loads=LOADS, jobs=1)
            reserve = min(drawn.reserve, runs.highest)
            for load, experiment in zip(LOADS, runs.experiments, strict=True):
                machine = runs.machine(experiment, reserve)
                began, done = time.process_time(), []
                running = simulation.SchedulerSimulation(machine, random.Random(seed).randrange(100))
                again = RESTART_MS
                for job in running:
                    done.append((job.began, job.response, job.successful, job.cpu))
                    if job.began + job.response > again:
                        running.restart_loads()
                        again += RESTART_MS
                    if job.began > simulated_ms:
                        break
                seconds += time.process_time() - began
                jobs[f"{drawn.name} next to {load}"] = done
    json.dump((not str(simulation.__file__).endswith(".py"), seconds, jobs), sys.stdout)


def main(words: list[str]) -> int:
    components = int(words[1]) if len(words) > 1 else 40
    with tempfile.TemporaryDirectory() as folder:
        wheel = Path(words[0]) if words else build_wheel(Path(folder))
        ZipFile(wheel).extractall(Path(folder) / "wheel")
        plain, compiled = run_in(CHECKOUT, components), run_in(Path(folder) / "wheel", components)
    return report(
        [
            Figure(name="compiled / Python, processor time", value=compiled.seconds / plain.seconds, at_most=1 / 3),
            Figure(name="largest difference of a time", value=difference(plain, compiled), unit="ms", at_most=1e-9),
        ]
    )


if __name__ == "__main__":
    if sys.argv[1:2] == ["--run"]:
        _run(int(sys.argv[2]), float(sys.argv[3]))
    else:
        sys.exit(main(sys.argv[1:]))
