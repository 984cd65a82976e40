"""What a plan proposes where not everything fits is done to the letter, in the manifest's text, and planned."""

import json
import random
import re
from collections.abc import Callable, Iterator
from copy import deepcopy
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import pytest
import yaml

from tests.builders_measured import a_setting
from tests.effort import examples
from tests.measuring import leave_log, steady
from tests.unit.cli.running import rarms

Manifest = dict[str, Any]
LEVELS = range(10, 96, 5)
APT = 100


@dataclass(frozen=True, slots=True, kw_only=True)
class Robot:
    """A manifest, and the CR that each of its measured components needs."""

    manifest: Manifest
    needs: dict[str, int]

    def lies_in(self, folder: Path) -> None:
        """The manifest and its data logs as files, in place of what lay there before."""
        text = yaml.safe_dump(self.manifest, sort_keys=False)
        (folder / "rarms.yaml").write_text(text, encoding="utf-8", newline="\n")

    def is_measured_in(self, folder: Path) -> None:
        """Mean response times fall as the CR rises, and reach the threshold at what the component needs."""
        for name, need in self.needs.items():
            means = {level: APT * 0.98 * need / level for level in LEVELS}
            leave_log(folder, [name], [a_setting(level, steady(name, mean, jobs=60)) for level, mean in means.items()])


def a_robot(seed: int) -> Robot:
    """On one or two hosts, with fixed and measured reserves, and sometimes too little memory."""
    chance = random.Random(seed)
    hosts: Manifest = {
        f"h{at}": {"logical_processors": 2, "memory": f"{chance.choice([2, 4, 16])} GiB"}
        for at in range(chance.choice([1, 1, 2]))
    }
    for host in hosts.values() if chance.random() < 0.5 else ():
        host["platform"] = "two-core"
    everywhere = len({component.get("platform", name) for name, component in hosts.items()}) == 1
    measured_at_all = chance.choice([0.0, 0.5, 1.0])
    components: Manifest = {}
    needs: dict[str, int] = {}
    for at in range(chance.randint(3, 5) * len(hosts)):
        name = f"c{at}"
        memory = chance.choice([256, 512, 1024])
        component = components[name] = {"criticality": chance.randint(1, 50), "memory": f"{memory} MiB"}
        if chance.random() < measured_at_all:
            needs[name] = chance.choice(LEVELS[4:12])
            component |= {
                "apt": {"mean_response_time": {"at_most": f"{APT} ms"}},
                "simulation": {"work": "10 ms"},
                "cpu": {"reserve": "measured"},
            }
            if not everywhere:
                component["hosts"] = ["h0"]
        else:
            share, processors = chance.randint(5, 60), chance.randint(5, 110) / 100
            component["cpu"] = {"reserve": chance.choice([f"{share} %", f"{processors} LP"])}
            if chance.random() < 0.3:
                component["processors"] = chance.choice([1, 2])
                component["cpu"] = {"reserve": f"{min(processors, 0.9)} LP"}
            if chance.random() < 0.3:
                component["hosts"] = [chance.choice(sorted(hosts))]
    return Robot(
        manifest={"schema": "rarms/v1", "application": {"name": "robot"}, "hosts": hosts, "components": components},
        needs=needs,
    )


def advice_of(folder: Path) -> str | None:
    """What the plan proposes where everything does not fit; None: it fits, or for another reason."""
    answer = rarms("plan", "-f", str(folder), "--json")
    if answer.code != 4:
        assert answer.code == 0, answer.err
        return None
    found = [load for load in json.loads(answer.out)["findings"] if load["severity"] == "error"]
    assert {finding["code"] for finding in found} <= {"RARMS014", "RARMS120", "RARMS121", "RARMS122", "RARMS060"}, found
    advice: str = found[0]["advice"]
    return None if found[0]["code"] == "RARMS060" else advice


def ways_in(advice: str) -> Iterator[list[str]]:
    """The proposals, each as its changes."""
    now: list[str] = []
    advice = advice.replace("All of these changes together would be enough:", "- all of these:")
    for line in re.sub(r"^This change would be enough: ", "- ", advice, flags=re.MULTILINE).splitlines():
        if line.startswith("  - "):
            now.append(line.removeprefix("  - ").rstrip("."))
            continue
        if now:
            yield now
        now = [] if line.startswith("Each of these changes alone") else [line.removeprefix("- ").rstrip(".")]
    if now:
        yield now


def _mib(text: str) -> int:
    number, unit = text.split()
    return int(number) * {"MiB": 1, "GiB": 1024}[unit]


def _reserves(manifest: Manifest, name: str, amount: str) -> None:
    manifest["components"][name]["cpu"]["reserve"] = amount


def _partition_reserves(manifest: Manifest, name: str, amount: str) -> None:
    manifest["partitions"][name]["cpu"]["reserve"] = amount


def _memory(manifest: Manifest, more: str, host: str) -> None:
    entry = manifest["hosts"][host]
    entry["memory"] = f"{_mib(entry['memory']) + _mib(more)} MiB"


def _processors(manifest: Manifest, number: str, hosts: str) -> None:
    for name in re.findall(r"h\d", hosts):
        manifest["hosts"][name]["logical_processors"] += 1 if number.lower() == "one" else int(number)


def _apt(manifest: Manifest, name: str, value: str) -> None:
    manifest["components"][name]["apt"]["mean_response_time"]["at_most"] = value


def _together(manifest: Manifest, names: str, reserve: str) -> None:
    members = re.findall(r"c\d+", names)
    manifest.setdefault("partitions", {})[members[-1]] = {"components": members, "cpu": {"reserve": reserve}}


def _anew(manifest: Manifest, number: str, hosts: str, width: str | None, names: str | None) -> None:
    _processors(manifest, number, hosts)
    for name in re.findall(r"c\d+", names or ""):
        manifest["components"][name]["processors"] = int(width or "")


def _nothing(_manifest: Manifest) -> None:
    """It stands above a list."""


COMBINED = r"(c\d+(?:, c\d+)*(?: and c\d+)?)"
MORE = r"([oO]ne|\d+) more logical processors? on ((?:each of )?h\d(?: and h\d)?)"
KINDS: dict[str, tuple[str, Callable[..., None]]] = {
    "list": (r"[aA]ll of these:|Combining components may be enough\. Check each of these .*:", _nothing),
    "reserve": (r"(c\d+) reserves (\S+ (?:% of host|LP)) instead of .*", _reserves),
    "partition": (r"partition (c\d+) reserves (\S+ (?:% of host|LP)) instead of .*", _partition_reserves),
    "memory": (r"(\d+ [GM]iB) more memory on (h\d)", _memory),
    "processors": (MORE, _processors),
    "apt": (r"(c\d+): mean_response_time at most (\S+ \w+) instead of .*", _apt),
    "combine": (
        rf"(?:Combining components may be enough\. .*: )?{COMBINED} reserve .* in two .* up to (\S+ LP)",
        _together,
    ),
    "anew": (rf"{MORE}(?:, with `processors: (\d+)` for (.*) as now)?,? may be enough.*", _anew),
    "moving": (r"use `--max-disruption removal`, .*", _nothing),
}


def done(manifest: Manifest, changes: list[str]) -> tuple[Manifest, set[str]]:
    """The manifest with these changes made by hand, and the kinds that they are of."""
    after, kinds = deepcopy(manifest), set()
    for change in changes:
        for kind, (pattern, make) in KINDS.items():
            if found := re.fullmatch(pattern, change):
                make(after, *found.groups())
                kinds.add(kind)
                break
        else:
            pytest.fail(f"this test knows no way to do this: {change}")
    return after, kinds


def kinds_that_fit(robot: Robot, folder: Path) -> set[str]:
    """All kinds of changes that are proposed; each proposal is done, and fits."""
    kinds: set[str] = set()
    for changes in ways_in(advice_of(folder) or ""):
        after, these = done(robot.manifest, changes)
        changed = Robot(manifest=after, needs=robot.needs)
        changed.lies_in(folder)
        if "anew" in these:
            changed.is_measured_in(folder)
        moving = ["--max-disruption", "removal"] if "moving" in these else []
        answer = rarms("plan", "-f", str(folder), *moving)
        assert answer.code == 0, (changes, answer.err)
        kinds |= these
    return kinds


@pytest.mark.parametrize("seed", range(examples(10)))
def test_proposed_change_fits_when_made(seed: int, tmp_path: Path) -> None:
    robot = a_robot(seed)
    robot.lies_in(tmp_path)
    robot.is_measured_in(tmp_path)

    assert kinds_that_fit(robot, tmp_path) <= set(KINDS)


FIXED = """\
schema: rarms/v1
application: { name: robot }
hosts:
  h0: { logical_processors: 2, memory: 4 GiB }
components:
"""
MEASURED = "apt: { mean_response_time: { at_most: 100 ms } }, simulation: { work: 10 ms }, memory: 64 MiB"


@pytest.mark.parametrize(
    ("components", "needs", "kinds"),
    [
        (
            """\
  c0: { criticality: 1, cpu: { reserve: 70 % }, memory: 3 GiB }
  c1: { criticality: 2, cpu: { reserve: 50 % }, memory: 2 GiB }
""",
            {},
            {"list", "memory", "reserve"},
        ),
        (
            """\
  c0: { criticality: 1, cpu: { reserve: 1.2 LP }, memory: 3 GiB }
  c1: { criticality: 2, cpu: { reserve: 1.2 LP }, memory: 2 GiB }
""",
            {},
            {"list", "memory", "reserve", "processors"},
        ),
        (
            """\
  c0: { criticality: 1, cpu: { reserve: 40 % }, memory: 64 MiB }
  c1: { criticality: 2, cpu: { reserve: 40 % }, memory: 64 MiB }
  c2: { criticality: 2, cpu: { reserve: 50 % }, memory: 64 MiB }
partitions:
  c0: { components: [c0, c1], cpu: { reserve: 70 % } }
""",
            {},
            {"partition", "reserve"},
        ),
        (
            f"""\
  c0: {{ criticality: 1, {MEASURED}, apart: [c2, c3] }}
  c1: {{ criticality: 2, {MEASURED}, apart: [c2, c3] }}
  c2: {{ criticality: 3, {MEASURED} }}
  c3: {{ criticality: 4, {MEASURED} }}
""",
            {"c0": 50, "c1": 50, "c2": 50, "c3": 50},
            {"list", "apt", "combine", "anew"},
        ),
    ],
)
def test_what_is_missing_decides_what_is_proposed(
    components: str, needs: dict[str, int], kinds: set[str], tmp_path: Path
) -> None:
    robot = Robot(manifest=yaml.safe_load(FIXED + components), needs=needs)
    robot.lies_in(tmp_path)
    robot.is_measured_in(tmp_path)

    assert kinds_that_fit(robot, tmp_path) == kinds


def test_existing_partitions_fit_when_moved(tmp_path: Path) -> None:
    manifest: Manifest = yaml.safe_load(
        FIXED
        + """\
  c0: { criticality: 1, cpu: { reserve: 60 % }, memory: 64 MiB }
  c1: { criticality: 2, cpu: { reserve: 30 % }, memory: 64 MiB }
"""
    )
    manifest["hosts"]["h1"] = {"logical_processors": 2, "memory": "4 GiB"}
    Robot(manifest=manifest, needs={}).lies_in(tmp_path)
    assert rarms("apply", "-f", str(tmp_path), "--auto-approve").code == 0
    manifest["components"]["c1"]["cpu"]["reserve"] = "50 %"
    grown = Robot(manifest=manifest, needs={})
    grown.lies_in(tmp_path)

    assert kinds_that_fit(grown, tmp_path) == {"moving", "reserve"}


def test_pair_is_offered_above_known_misses(tmp_path: Path) -> None:
    components = f"  c0: {{ criticality: 1, {MEASURED} }}\n  c1: {{ criticality: 2, {MEASURED} }}\n"
    robot = Robot(manifest=yaml.safe_load(FIXED + components), needs={"c0": 55, "c1": 60})
    robot.lies_in(tmp_path)
    robot.is_measured_in(tmp_path)

    def pair() -> str:
        said = " ".join(rarms("plan", "-f", str(tmp_path)).err.split())
        return said.partition("c0 and c1 reserve ")[2].partition(". ")[0]

    def shown_to_miss(*levels: int) -> None:
        settings = [a_setting(level, *(steady(name, 2.0 * APT, jobs=60) for name in ("c0", "c1"))) for level in levels]
        leave_log(tmp_path, ["c0", "c1"], settings)

    assert pair() == "2.7 LP in two partitions on h0; in one partition they may reserve up to 2 LP"
    shown_to_miss(60)
    assert pair() == (
        "2.7 LP in two partitions on h0; in one partition they were shown to miss with 1.2 LP, "
        "and may reserve up to 2 LP"
    )
    shown_to_miss(60, 100)
    assert pair() == "", "the host has no more than 2 LP"
