"""What Ansible's walk over many simulated robots takes with rarms, next to its own `debug` and next to the library.

`python -m benchmarks.fleet [ROBOTS ...]`: 10, 100 and 1,000 without arguments. As root with control groups
and an sshd, slices of this machine are applied over ssh on the loopback interface, too, 100 without arguments.
"""

import json
import os
import shutil
import subprocess
import sys
import tempfile
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

from benchmarks.timing import Figure, report
from rarms_iac.providers.cgroups.provider import STATE_FOLDER
from tests.needs import NEEDS
from tests.remote import a_server

CHECKOUT = Path(__file__).resolve().parent.parent.parent
FORKS = 4
OVER_SSH = 100
SSH_GOAL_S = 20.0
LARGEST = 1_000
GOAL = 2.5  # times Ansible's own debug, at 1,000 robots
MEMORY_GOAL_MIB = 200.0  # of Ansible's own process
MANIFEST = """\
schema: rarms/v1
application: { name: robot }
hosts:
  onboard: { provider: simulated, logical_processors: 4, memory: 8 GiB, platform: cell }
components:
  vision: { criticality: 50, memory: 1 GiB, processors: 2, cpu: { reserve: 0.8 LP } }
  speech: { criticality: 40, memory: 1 GiB, processors: 1, cpu: { reserve: 0.4 LP } }
  motion: { criticality: 90, memory: 1 GiB, processors: 1, cpu: { reserve: 0.5 LP } }
"""
LIBRARY = """\
import sys
from pathlib import Path
import rarms_iac as rarms
for overlay in sorted(Path("robots").glob("*.yaml")):
    rarms.plan(rarms.load("rarms.yaml", overlays=[str(overlay)]))
"""


COUNTED = """\
import os, resource, subprocess, sys, time
begun = time.perf_counter()
code = subprocess.run(sys.argv[1:], stdin=subprocess.DEVNULL, stdout=sys.stderr).returncode
wall = time.perf_counter() - begun
used = resource.getrusage(resource.RUSAGE_CHILDREN)
print(code, wall, used.ru_utime + used.ru_stime, used.ru_maxrss / 1024)
"""


@dataclass(frozen=True, slots=True, kw_only=True)
class Walk:
    """What a program took, with all that it started."""

    wall_s: float
    processor_s: float
    largest_mib: float  # of its largest process

    def __str__(self) -> str:
        return f"{self.wall_s:6.1f} s, {self.processor_s:6.1f} s of processor time, {self.largest_mib:4.0f} MiB"


def main(counts: Sequence[int]) -> int:
    """Print the figures for these numbers of robots.

    Returns:
        1 where a goal is missed.
    """
    figures: list[Figure] = []
    for count in counts:
        with tempfile.TemporaryDirectory() as folder:
            make_fleet(Path(folder), count)
            walks = {name: walk(Path(folder), words) for name, words in PROGRAMS.items()}
        for name, taken in walks.items():
            print(f"{count:5} robots, {name:21} {taken}", flush=True)
        is_judged = count == LARGEST
        ratio = walks["rarms.fleet.apply"].wall_s / walks["Ansible's own debug"].wall_s
        memory = walks["rarms.fleet.apply"].largest_mib
        figures += [
            Figure(name=f"{count} robots planned / Ansible's debug", value=ratio, at_most=GOAL if is_judged else None),
            Figure(
                name=f"{count} robots: the largest process",
                value=memory,
                unit="MiB",
                at_most=MEMORY_GOAL_MIB if is_judged else None,
            ),
        ]
    figures += over_ssh(min(OVER_SSH, max(counts)))
    return report(figures)


LINUX = """\
schema: rarms/v1
application: { name: robot }
hosts:
  onboard: { provider: linux, logical_processors: 2, memory: 4 GiB, connect: { ssh: cell } }
components:
  vision: { criticality: 20, memory: 64 MiB, processors: 1, cpu: { reserve: 0.2 LP } }
"""


def over_ssh(count: int) -> list[Figure]:
    """Plan so many slices of this machine over its own sshd, apply the plans, and remove the slices.

    Returns:
        The wall times; nothing where this machine offers no control groups, or no sshd.
    """
    if NEEDS["ssh"].missing() or NEEDS["control-groups"].missing():
        print("No slices over ssh: they need root, control groups and sshd.")
        return []
    with tempfile.TemporaryDirectory() as name, a_server(Path(name)) as remote:
        folder = Path(name)
        make_fleet(folder, count)
        (folder / "rarms.yaml").write_text(LINUX, encoding="utf-8")
        for path in (folder / "robots").iterdir():
            path.write_text(f"hosts: {{ onboard: {{ linux: {{ slice: fleet-{path.stem} }} }} }}\n", encoding="utf-8")
        absent = [{"hosts": "all", "gather_facts": False, "tasks": [{"rarms.fleet.apply": {"state": "absent"}}]}]
        (folder / "absent.yml").write_text(json.dumps(absent), encoding="utf-8")
        raw = [{"hosts": "all", "gather_facts": False, "tasks": [{"ansible.builtin.raw": "true"}]}]
        (folder / "raw.yml").write_text(json.dumps(raw), encoding="utf-8")
        words = ("ansible-playbook", "-i", "robots.fleet.yml", "-f", str(FORKS))
        programs = remote.environment["PATH"]
        walk(folder, (*words, "raw.yml"), programs)  # it leaves a connection of each robot open, as Ansible does
        taken: dict[str, Walk] = {}
        try:
            taken["Ansible's own raw"] = walk(folder, (*words, "raw.yml"), programs)
            taken["planned"] = walk(folder, (*words, "site.yml", "--check"), programs)
            taken["applied"] = walk(folder, (*words, "site.yml"), programs)
        finally:
            walk(folder, (*words, "absent.yml"), programs)
            for slices in STATE_FOLDER.glob("fleet-r-*"):
                shutil.rmtree(slices)
    for name, walked in taken.items():
        print(f"{count:5} over ssh, {name:21} {walked}", flush=True)
    return [
        Figure(
            name=f"{count} slices over ssh, {name}",
            value=walked.wall_s,
            unit="s",
            at_most=SSH_GOAL_S if name == "planned" and count == OVER_SSH else None,
        )
        for name, walked in taken.items()
    ]


PROGRAMS = {
    "Ansible's own debug": ("ansible-playbook", "-i", "robots.fleet.yml", "debug.yml", "-f", str(FORKS)),
    "rarms.fleet.apply": ("ansible-playbook", "-i", "robots.fleet.yml", "site.yml", "--check", "-f", str(FORKS)),
    "the library alone": (sys.executable, "-c", LIBRARY),
}


def make_fleet(folder: Path, count: int) -> None:
    """Write a manifest, an overlay for each robot, an inventory and two playbooks.

    Args:
        folder: it is there, and empty.
    """
    (folder / "robots").mkdir()
    for number in range(count):
        reserve = 0.3 + 0.1 * (number % 5)
        overlay = f"components: {{ speech: {{ cpu: {{ reserve: {reserve:.1f} LP }} }} }}\n"
        (folder / "robots" / f"r-{number:04}.yaml").write_text(overlay, encoding="utf-8")
    (folder / "rarms.yaml").write_text(MANIFEST, encoding="utf-8")
    (folder / "robots.fleet.yml").write_text(
        "plugin: rarms.fleet.manifests\noverlays: [robots/*.yaml]\n", encoding="utf-8"
    )
    for name, task in (("debug", {"ansible.builtin.debug": {"msg": "here"}}), ("site", {"rarms.fleet.apply": {}})):
        play = [{"hosts": "all", "gather_facts": False, "tasks": [task]}]
        (folder / f"{name}.yml").write_text(json.dumps(play), encoding="utf-8")


def walk(folder: Path, words: Sequence[str], path: str = os.environ["PATH"]) -> Walk:
    """Run a program to its end.

    Args:
        words: the program, in this environment, and its arguments.

    Returns:
        What it took.

    Raises:
        RuntimeError: it failed.
    """
    environment = {
        **os.environ,
        "PATH": f"{Path(sys.executable).parent}{os.pathsep}{path}",
        "PYTHONPATH": str(CHECKOUT),
        "ANSIBLE_COLLECTIONS_PATH": str(CHECKOUT / "ansible"),
        "ANSIBLE_HOME": str(folder / ".ansible"),
    }
    ran = subprocess.run(
        [sys.executable, "-c", COUNTED, *words],
        cwd=folder,
        env=environment,
        capture_output=True,
        encoding="utf-8",
        check=False,
    )
    code, wall, processor, largest = ran.stdout.split()
    if code != "0":
        raise RuntimeError(f"{words[0]} ended with {code}: {ran.stderr[-2000:]}")
    return Walk(wall_s=float(wall), processor_s=float(processor), largest_mib=float(largest))


if __name__ == "__main__":
    sys.exit(main([int(word) for word in sys.argv[1:]] or [10, 100, LARGEST]))
