"""Writes docs/evaluation.md and its figures from what `benchmarks.linux.evaluation` recorded.

Usage: python -m benchmarks.linux.page FOLDER-OF-THE-ROBOT LOG

The page's words are in `evaluation.md.j2`; what was not measured is named there.
"""

import os
import platform
import sys
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from datetime import UTC, datetime
from math import isfinite
from pathlib import Path
from statistics import median

from jinja2 import Environment, FileSystemLoader, StrictUndefined

from benchmarks.linux.evaluation import (
    BROWSERS,
    FDP,
    LOADS,
    PPP,
    REPEATS,
    RESERVES,
    SRP,
    VSP,
    bracket,
    components_of,
    rules,
)
from benchmarks.linux.experiments import (
    MEASURED_JOBS,
    MEASURED_S,
    PAIRS,
    SLICE,
    Experiment,
    Log,
    meets,
    series_of,
    value_of,
    values_in,
    values_of,
    work_of,
)
from benchmarks.paper.drawing import Chart, draw
from benchmarks.timing import commit
from rarms_iac.model.indexes import index_named
from rarms_iac.model.system import Component
from rarms_iac.providers.cgroups.groups import GroupTree
from rarms_iac.providers.cgroups.trees import find_tree
from rarms_iac.texts.indexes import show_threshold

DOCS = Path(__file__).resolve().parents[2] / "docs"


@dataclass(frozen=True, slots=True, kw_only=True)
class Trial:
    """A way of choosing a reservation: what it chose for a component, or for all of them, and how that did."""

    reserve: int  # per cent of the host
    missed: int  # of `runs`, those in which the APT was not met
    runs: int
    too_much: int  # points above what the sweep found


@dataclass(frozen=True, slots=True, kw_only=True)
class Findings:
    """Everything that was seen of one component."""

    component: Component
    curve: Mapping[int, Mapping[str, float]]  # by reservation, then index
    too_little: int  # the highest reservation tried, in whole per cent, at which an index is not good enough
    needed: int | None  # the next one that was tried; with it and all above, every index is good enough
    measured: int | None  # what `rarms measure` found
    loaded: Mapping[int, float]  # the mean response time in ms, by what the load uses
    trials: Mapping[str, Trial]  # by rule
    work: Mapping[int, Sequence[float]]  # by reservation, of each run: ms of processor time a job

    @property
    def thresholds(self) -> str:
        """The APT in words."""
        return ", ".join(
            f"{index.replace('_', ' ')} {show_threshold(index_named(index), threshold)}"
            for index, threshold in self.component.apt.items()
        )

    @property
    def least(self) -> str:
        """What the sweep found, in per cent of the host."""
        if self.needed is None:
            return f"more than {max(RESERVES)} %"
        above = self.too_little + 1
        return f"{self.needed} %" if above == self.needed else f"{above} to {self.needed} %"

    @property
    def apart(self) -> str:
        """By how many points what `rarms measure` found is outside of what the sweep found."""
        if self.measured is None or self.needed is None:
            return ""
        return f"{min(self.measured - self.too_little - 1, 0) + max(self.measured - self.needed, 0):+} points"


def main() -> None:
    """Write the page and its figures, as far as they are recorded."""
    robot, record = Path(sys.argv[1]).resolve(), Log(path=Path(sys.argv[2]))
    components = components_of(robot, datetime.now(UTC).date())
    found = [_findings(record, component, len(components)) for component in components.values()]
    browsers = times_with_browsers(record)
    _write(DOCS / "figures" / "linux-figure-1.svg", draw(_chart_1(next(each for each in found if _is(FDP, each)))))
    if robotic := _robotic(found):
        _write(DOCS / "figures" / "linux-figure-3.svg", draw(_chart_3(robotic)))
    if browsers:
        _write(DOCS / "figures" / "linux-figure-4.svg", draw(_chart_4(browsers)))
    _write(DOCS / "evaluation.md", page(found, browsers, _machine(record)))


def page(
    found: Sequence[Findings], browsers: Mapping[tuple[int, int], Sequence[float]], machine: Mapping[str, object]
) -> str:
    """Return the text of the page.

    Args:
        browsers: By pair of reservations, the response time in ms for each number of browsers; empty: not measured.
        machine: What `_machine` says of it.
    """
    environment = Environment(
        loader=FileSystemLoader(Path(__file__).parent), undefined=StrictUndefined, trim_blocks=True
    )
    environment.filters["number"] = _number
    return environment.get_template("evaluation.md.j2").render(
        found=found,
        browsers=browsers,
        robotic=_robotic(found),
        totals=_totals(found) if all(each.trials for each in found) else {},
        reserves=RESERVES,
        loads=LOADS,
        counts=BROWSERS,
        repeats=REPEATS,
        measured_s=round(MEASURED_S),
        measured_jobs=MEASURED_JOBS,
        **machine,
    )


def _is(name: str, findings: Findings) -> bool:
    return findings.component.name == name


def _robotic(found: Sequence[Findings]) -> Mapping[str, Findings]:
    """Return the components by the paper's name, where each ran under load."""
    by_name = {each.component.name: each for each in found}
    names = {"FDP": FDP, "SRP": SRP, "VSP": VSP, "PPP": PPP}
    return {short: by_name[name] for short, name in names.items()} if all(each.loaded for each in found) else {}


def _totals(found: Sequence[Findings]) -> Mapping[str, Trial]:
    """Return what each rule chose for all components."""
    trials = {rule: [each.trials[rule] for each in found] for rule in found[0].trials}
    return {
        rule: Trial(
            reserve=sum(each.reserve for each in tried),
            missed=sum(each.missed for each in tried),
            runs=sum(each.runs for each in tried),
            too_much=sum(each.too_much for each in tried),
        )
        for rule, tried in trials.items()
    }


def _findings(record: Log, component: Component, components: int) -> Findings:
    name = component.name
    too_little, needed = bracket(record, component)

    def trial(reserve: int) -> Trial:
        runs = record.runs("reserve", name, reserve)
        missed = sum(not meets(component, values_of(component, run)) for run in runs)
        return Trial(reserve=reserve, missed=missed, runs=len(runs), too_much=max(0, reserve - (needed or 0)))

    measured = record.records.get(Experiment(kind="measured", component=name))
    chosen = {} if measured is None else rules(record, component, _processors(), components)
    trials = {rule: trial(reserve) for rule, reserve in chosen.items()}
    loaded = {percent: record.runs("class", name, percent) for percent in LOADS}
    return Findings(
        component=component,
        curve={reserve: values_in(record.runs("reserve", name, reserve), component) for reserve in RESERVES},
        too_little=too_little,
        needed=needed,
        measured=None if measured is None else round(measured["reserve"]),
        loaded={percent: value_of("mean_response_time", runs[0]) for percent, runs in loaded.items()}
        if all(loaded.values())
        else {},
        trials=trials if all(each.runs for each in trials.values()) else {},
        work=_work(record, name),
    )


def _work(record: Log, name: str) -> Mapping[int, Sequence[float]]:
    runs = [
        (each.setting, work_of(seen))
        for each, seen in record.records.items()
        if (each.kind, each.component) == ("reserve", name)
    ]
    return {reserve: [work for other, work in runs if other == reserve] for reserve, _ in runs}


def times_with_browsers(record: Log) -> Mapping[tuple[int, int], Sequence[float]]:
    """By pair of reservations, FDP's mean response time for each number of browsers; nothing where some is missing."""
    if any(Experiment(kind="browsers", component=FDP, setting=count) not in record.records for count in BROWSERS):
        return {}
    pairs = [record.records[Experiment(kind="browsers", component=FDP, setting=count)]["pairs"] for count in BROWSERS]
    return {
        pair: [value_of("mean_response_time", series_of(FDP, each[number])) for each in pairs]
        for number, pair in enumerate(PAIRS)
    }


def _write(path: Path, text: str) -> None:
    path.write_text(text, encoding="utf-8", newline="\n")


def _processors() -> int:
    return len(os.sched_getaffinity(0))


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


def _chart_3(robotic: Mapping[str, Findings]) -> Chart:
    labels = {"FDP": "FDP, FIFO 30", "SRP": "SRP, FIFO 31"}
    lines = {
        labels.get(name, name): [(percent, ms / each.loaded[0]) for percent, ms in each.loaded.items()]
        for name, each in robotic.items()
    }
    return Chart(
        title="One Linux without partitions: what a job takes, without load = 1",
        across="processors used by the load (%)",
        up="mean response time, times that without load",
        lines=lines,
        span=(0, 100),
        most=max(2.5, -(-max(y for line in lines.values() for _, y in line) // 1)),
    )


def _chart_4(browsers: Mapping[tuple[int, int], Sequence[float]]) -> Chart:
    lines = {f"{p1}/{p2}": list(zip(BROWSERS, times, strict=True)) for (p1, p2), times in browsers.items()}
    return Chart(
        title="Face detection with browsers, by what P1 and P2 reserve (%)",
        across="browsers in P2",
        up="mean response time (ms)",
        lines=lines,
        span=(0, max(BROWSERS)),
        most=100 * -(-max(y for line in lines.values() for _, y in line) // 100),
    )


def _machine(record: Log) -> Mapping[str, object]:
    """Return what the head of the page says of this machine and of how quiet it was."""
    model = next(
        line.partition(":")[2].strip()
        for line in Path("/proc/cpuinfo").read_text(encoding="utf-8").splitlines()
        if line.startswith("model name")
    )
    tree = find_tree(SLICE)
    return {
        "model": model,
        "processors": _processors(),
        "memory_gib": os.sysconf("SC_PAGE_SIZE") * os.sysconf("SC_PHYS_PAGES") / 2**30,
        "linux": platform.release(),
        "groups": tree.version if isinstance(tree, GroupTree) else "none",
        "python": platform.python_version(),
        "today": datetime.now(UTC).date(),
        "commit": commit()[:9],
        "experiments": len(record.records),
        "others": median(_others(record)),
    }


def _others(record: Log) -> Iterator[float]:
    """Of each run with busy loops, what neither group got, in per cent of the host."""
    for experiment, seen in record.records.items():
        if experiment.kind == "reserve" and len(consumed := seen["consumed"]) > 1:
            (began, *first), (ended, *last) = consumed[0], consumed[-1]
            yield 100 - 100 * (sum(last) - sum(first)) / (ended - began) / _processors()


def _number(value: float) -> str:
    return f"{value:.1f}" if isfinite(value) else "none"


if __name__ == "__main__":
    main()
