"""What `rarms measure` answers for the ROS robot's face detector, and a sweep with the same load, on this Linux.

`python -m benchmarks.linux.ros` starts the camera of `manifests/ros-robot` and measures the node by the time between
messages next to the manifest's busy loop: first with `--quick` as `make demo-ros` does, then with 99 % confidence. It
then writes groups by hand and halves what lies around the first answer. Needs root, what `make demo-ros` installs, and
a quiet machine, on which it takes about eight minutes. Exit code 1: the answer of `--quick` is more than two points and
more than 5 % from the sweep, or other programs used more than 2 % of the machine.
"""

import os
import shlex
import subprocess
import sys
import tempfile
import time
from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from datetime import UTC, datetime
from pathlib import Path

from benchmarks.linux.experiments import workbench
from benchmarks.linux.loads import CHECKOUT, OTHER_WORK, OtherWork, measured, report
from rarms_iac.manifest.load import load_system

NODE = "face-detection"
SECONDS = 20.0
"""So long a run of the sweep lasts: 60 images."""

BUDGET = "policy: { measuring: { setting: 1 min } }\n"


def main() -> int:
    """Print what was measured and what the sweep found."""
    processors = len(os.sched_getaffinity(0))
    with tempfile.TemporaryDirectory() as folder:
        robot = Path(folder) / "robot"
        robot.mkdir()
        subprocess.run((str(CHECKOUT / "scripts/make-ros-robot"), str(robot)), check=True)
        (robot / "budget.yaml").write_text(BUDGET, encoding="utf-8")
        system = load_system(str(robot / "rarms.yaml"), today=datetime.now(UTC).date()).system
        assert system is not None
        environment = environment_of(robot)
        other = OtherWork()
        with camera(robot, environment):
            quick = measured(robot, environment, NODE, is_quick=True)
            answers = measured(robot, environment, NODE)
            with workbench(robot, environment, processors) as machine:
                is_near = report(machine, system.components[NODE], quick, SECONDS)
        share = other.percent(processors)
    (answer,) = answers.values()
    print(f"With 99 % confidence: {f'{answer:g} %' if answer else 'no answer'}")
    print(f"Other work on the machine: {share:.1f} %; a run with more than {OTHER_WORK:g} % does not count")
    return 0 if is_near and share <= OTHER_WORK else 1


def environment_of(robot: Path) -> dict[str, str]:
    """Return the variables of the robot's nodes, as `scripts/make-ros-robot` wrote them."""
    lines = shlex.split((robot / "robot.env").read_text(encoding="utf-8"))
    own = dict(line.split("=", 1) for line in lines)
    return {**os.environ, "PATH": f"{Path(sys.executable).parent}:{os.environ['PATH']}", **own}


@contextmanager
def camera(robot: Path, environment: Mapping[str, str]) -> Iterator[None]:
    """Have the ROS master and the camera running, outside of all groups."""
    with (robot / "roslaunch.log").open("w", encoding="utf-8") as log:
        port = environment["ROS_MASTER_URI"].rpartition(":")[2]
        words = ("roslaunch", "-p", port, str(robot / "robot.launch"))
        launched = subprocess.Popen(words, env=dict(environment), stdout=log, stderr=log)
        try:
            wait_for_images(environment)
            yield
        finally:
            launched.terminate()
            launched.wait()


def wait_for_images(environment: Mapping[str, str]) -> None:
    """Wait until the camera publishes; RuntimeError: it does not within half a minute."""
    until = time.monotonic() + 30
    while time.monotonic() < until:
        done = subprocess.run(("rostopic", "list"), env=dict(environment), capture_output=True, text=True, check=False)
        if "image_raw" in done.stdout:
            return
        time.sleep(0.5)
    raise RuntimeError("the camera's node does not publish")


if __name__ == "__main__":
    sys.exit(main())
