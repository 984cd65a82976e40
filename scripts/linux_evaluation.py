"""Writes docs/evaluation.md and its figures: the Linux delivery robot, measured on this machine (root, 25 minutes).

Usage: python -m scripts.linux_evaluation FOLDER-OF-THE-ROBOT
"""

import json
import os
import platform
import subprocess
import sys
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from datetime import UTC, datetime
from math import isfinite
from pathlib import Path
from statistics import fmean

from rarms_iac.manifest.load import load
from rarms_iac.model.system import Component
from scripts.linux_experiments import Laboratory, Values, laboratory, meets, percentile, value_of, values_of
from scripts.paper_drawing import Chart, draw

DOCS = Path(__file__).resolve().parent.parent / "docs"
FDP, SRP, PPP, VSP = "face-detection", "speech-recognition", "path-planning", "video-streaming"
RESERVES = (5, 10, 15, 20, 25, 30, 35, 40, 45, 50, 60, 70, 80, 90)
LOADS = (0, 25, 50, 70, 85, 100)
PRIORITIES: Mapping[str, int | None] = {FDP: 30, SRP: 31, VSP: None, PPP: None}
SECONDS, REPEATS, USAGE_SECONDS = 6.0, 3, 30
MEASURED = "`rarms measure`"
INTRODUCTION = """\
Written by `make evaluation`, as root, from the real components of `manifests/delivery-robot-linux`: nothing here is
simulated. Reservations are shares of control groups, the interfering load is a busy loop on every processor. The
groups are set by hand and every index is worked out anew, so that this page can contradict `rarms measure`."""
FIGURE_1 = """\
The paper: face detection takes 600 to 800 ms at the low end, falls steeply, and reaches 88 ms at 70 %. It runs one
thread here, so that half of two processors is all that it can use, and the floor comes earlier."""
FIGURE_3 = """\
One operating system without partitions; stress-ng uses the given share of every processor. FDP and SRP run in
SCHED_FIFO at 30 and 31, VSP and PPP in the ordinary class. The paper: FDP and SRP do not change up to 100 %
utilisation; VSP and PPP degrade above about 70 %."""
TODAY = f"""\
Reservations are often taken from what a component consumes: its 95th or 99th percentile over windows of a second
(usage-based recommenders), or its mean and 20 %; or all get the same. Use was seen without interference for
{USAGE_SECONDS} s. Each reservation, in per cent of the host, then ran {REPEATS} times beside busy loops; *too much* is
what it has beyond what is needed: the least whole per cent at which at least two of three runs met the APT."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Trial:
    """A way of choosing a reservation: what it chose for a component, and how that did."""

    reserve: float  # per cent of the host
    missed: int  # of REPEATS runs beside busy loops, those in which the APT was not met


@dataclass(frozen=True, slots=True, kw_only=True)
class Findings:
    """Everything that was seen of one component."""

    component: Component
    curve: Mapping[int, Values]  # by reservation
    needed: int | None  # the least reservation, in whole per cent, from which on every index is good enough
    loaded: Mapping[int, float]  # the mean response time in ms, by what the load uses
    trials: Mapping[str, Trial]  # by rule


def main() -> None:
    """Runs all experiments and writes what they show."""
    robot = Path(sys.argv[1]).resolve()
    system = load(str(robot / "rarms.yaml"), today=datetime.now(UTC).date()).system
    assert system is not None
    measured = _measured(robot)
    with laboratory(robot, os.environ, len(os.sched_getaffinity(0)), SECONDS) as machine:
        version = machine.tree.version
        found = [
            _examine(machine, component, measured, 100 / len(system.components))
            for component in system.components.values()
        ]
    by_name = {findings.component.name: findings for findings in found}
    _write(DOCS / "figures" / "linux-figure-1.svg", draw(_chart_1(by_name[FDP])))
    _write(DOCS / "figures" / "linux-figure-3.svg", draw(_chart_3(by_name)))
    _write(DOCS / "evaluation.md", "\n".join([*_head(version), *page(found)]))


def page(found: Sequence[Findings]) -> list[str]:
    """Return the lines of the page but its head, which is about this machine."""
    by_name = {findings.component.name: findings for findings in found}
    return [*_figure_1(found), *_figure_3(by_name), *_comparison(found), ""]


def _write(path: Path, text: str) -> None:
    path.write_text(text, encoding="utf-8", newline="\n")


def _tell(text: str) -> None:
    print(text, file=sys.stderr, flush=True)


def _measured(robot: Path) -> Mapping[str, float]:
    """What `rarms measure` finds, in per cent of the host."""
    done = subprocess.run(["rarms", "measure", "--json"], cwd=robot, stdout=subprocess.PIPE, text=True, check=True)
    return {part["component"]: part["reserve"] for part in json.loads(done.stdout)["components"]}


def _examine(machine: Laboratory, component: Component, measured: Mapping[str, float], even_split: float) -> Findings:
    curve = {reserve: _show(machine, component, reserve) for reserve in RESERVES}
    loaded = {
        percent: value_of("mean_response_time", machine.at_load(component, percent, PRIORITIES[component.name]))
        for percent in LOADS
    }
    _tell(f"{component.name} under load: {loaded}")
    used = machine.usage(component, USAGE_SECONDS)
    rules = {
        MEASURED: measured[component.name],
        "95th percentile of use": percentile(used, 95),
        "99th percentile of use": percentile(used, 99),
        "mean of use and 20 %": 1.2 * fmean(used),
        "even split": even_split,
    }
    return Findings(
        component=component,
        curve=curve,
        needed=_needed(machine, component, curve),
        loaded=loaded,
        trials={rule: _try(machine, component, rule, reserve) for rule, reserve in rules.items()},
    )


def _show(machine: Laboratory, component: Component, reserve: float) -> Values:
    values = values_of(component, machine.at(component, reserve))
    _tell(f"{component.name} at {reserve:g} %: {dict(values)}")
    return values


def _try(machine: Laboratory, component: Component, rule: str, reserve: float) -> Trial:
    missed = sum(not meets(component, _show(machine, component, reserve)) for _ in range(REPEATS))
    _tell(f"{component.name}, {rule}: {reserve:.1f} %, missed {missed} of {REPEATS}")
    return Trial(reserve=reserve, missed=missed)


def _needed(machine: Laboratory, component: Component, curve: Mapping[int, Values]) -> int | None:
    """Go down from the sweep's least good reservation, per cent by per cent, as long as most of three runs are good."""
    least = None
    for reserve in reversed(RESERVES):
        if not meets(component, curve[reserve]):
            break
        least = reserve
    while least is not None and least > 1:
        runs = [meets(component, _show(machine, component, least - 1)) for _ in range(3)]
        if sum(runs) < 2:
            break
        least -= 1
    return least


def _chart_1(findings: Findings) -> Chart:
    index, threshold = next(iter(findings.component.apt.items()))
    line = [(reserve, values[index]) for reserve, values in findings.curve.items() if isfinite(values[index])]
    apt = float(threshold.value)
    return Chart(
        title="Face detection on Linux: response time by reservation",
        across="CPU reservation of P1 (%)",
        up="mean response time (ms)",
        lines={"measured": line, f"APT {apt:g} ms": [(0, apt), (100, apt)]},
        span=(0, 100),
        most=200 * -(-max(y for _, y in line) // 200),
    )


def _chart_3(by_name: Mapping[str, Findings]) -> Chart:
    lines = {
        name: [(percent, ms / by_name[component].loaded[0]) for percent, ms in by_name[component].loaded.items()]
        for name, component in (("FDP, FIFO 30", FDP), ("SRP, FIFO 31", SRP), ("VSP", VSP), ("PPP", PPP))
    }
    return Chart(
        title="One Linux without partitions: what a job takes, without load = 1",
        across="processors used by the load (%)",
        up="mean response time, times that without load",
        lines=lines,
        span=(0, 100),
        most=max(2.5, -(-max(y for line in lines.values() for _, y in line) // 1)),
    )


def _head(version: str) -> list[str]:
    model = next(
        line.partition(":")[2].strip()
        for line in Path("/proc/cpuinfo").read_text(encoding="utf-8").splitlines()
        if line.startswith("model name")
    )
    memory = os.sysconf("SC_PAGE_SIZE") * os.sysconf("SC_PHYS_PAGES") / 2**30
    return [
        "# The delivery robot on a real Linux",
        "",
        INTRODUCTION,
        "",
        f"- Machine: {model}, {len(os.sched_getaffinity(0))} logical processors, {memory:.1f} GiB.",
        f"- Linux {platform.release()}, control groups {version}, Python {platform.python_version()},",
        f"  {datetime.now(UTC):%Y-%m-%d}; load average over 15 minutes at the end: {os.getloadavg()[2]:.1f}.",
        f"- A run goes on for {SECONDS:g} s. Figures are single runs, and neighbours on the machine show in them.",
        "",
    ]


def _figure_1(found: Sequence[Findings]) -> list[str]:
    columns = [(findings, index) for findings in found for index in findings.component.apt]
    header = (f"{findings.component.name}: {index.replace('_', ' ')}" for findings, index in columns)
    return [
        "## Fig. 1: performance by reservation",
        "",
        FIGURE_1,
        "",
        "![Response time falls with the reservation](figures/linux-figure-1.svg)",
        "",
        _row("P1 reserves", *header),
        "|---:|" + "---:|" * len(columns),
        *(
            _row(f"{reserve} %", *(_number(findings.curve[reserve][index]) for findings, index in columns))
            for reserve in RESERVES
        ),
        "",
    ]


def _figure_3(by_name: Mapping[str, Findings]) -> list[str]:
    names = (FDP, SRP, VSP, PPP)
    return [
        "## Fig. 3: robotic classes under load",
        "",
        FIGURE_3,
        "",
        "![Classes stay flat, ordinary threads degrade](figures/linux-figure-3.svg)",
        "",
        _row("the load uses", *(f"{name} (ms)" for name in ("FDP", "SRP", "VSP", "PPP"))),
        "|---:|---:|---:|---:|---:|",
        *(_row(f"{percent} %", *(_number(by_name[name].loaded[percent]) for name in names)) for percent in LOADS),
        "",
    ]


def _comparison(found: Sequence[Findings]) -> list[str]:
    return [
        "## Beside what people do today",
        "",
        TODAY,
        "",
        _row("component", "needed", "rule", "it reserves", "missed", "too much"),
        "|---|---:|---|---:|---:|---:|",
        *(line for findings in found for line in _rows_of_trials(findings)),
        "",
        *_summary(found),
    ]


def _rows_of_trials(findings: Findings) -> list[str]:
    needed = "more than 90 %" if findings.needed is None else f"{findings.needed} %"
    return [
        _row(
            findings.component.name,
            needed,
            rule,
            f"{trial.reserve:.1f} %",
            f"{trial.missed} of {REPEATS}",
            "" if findings.needed is None else f"{max(0.0, trial.reserve - findings.needed):.1f}",
        )
        for rule, trial in findings.trials.items()
    ]


def _summary(found: Sequence[Findings]) -> list[str]:
    rows = [
        _row("rule", "runs that missed an APT", "points reserved in all", "points too much in all"),
        "|---|---:|---:|---:|",
    ]
    for rule in found[0].trials:
        trials = [(findings.trials[rule], findings.needed or 0) for findings in found]
        rows.append(
            _row(
                rule,
                f"{sum(trial.missed for trial, _ in trials)} of {REPEATS * len(trials)}",
                f"{sum(trial.reserve for trial, _ in trials):.1f}",
                f"{sum(max(0.0, trial.reserve - needed) for trial, needed in trials):.1f}",
            )
        )
    return rows


def _number(value: float) -> str:
    return f"{value:.1f}" if isfinite(value) else "none"


def _row(*cells: str) -> str:
    return f"| {' | '.join(cells)} |"


if __name__ == "__main__":
    main()
