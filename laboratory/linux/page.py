"""Writes docs/evaluation.md and its figures from what `laboratory.linux.evaluation` recorded.

Usage: python -m laboratory.linux.page FOLDER-OF-THE-ROBOT LOG
"""

import os
import platform
import sys
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from datetime import UTC, datetime
from math import inf, isfinite
from pathlib import Path
from statistics import median

from laboratory.linux.evaluation import (
    BROWSERS,
    FDP,
    JUDGED,
    LOADS,
    MEASURED,
    PPP,
    REPEATS,
    RESERVES,
    SRP,
    VSP,
    bracket,
    components_of,
    rules,
)
from laboratory.linux.experiments import (
    LONG_S,
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
from laboratory.linux.prediction import demand_of, foretold
from laboratory.linux.verdicts import DRAWS, FARTHEST, NEAREST, VerdictCount, count_verdicts
from laboratory.paper.drawing import Chart, draw
from rarms_iac.model.indexes import index_named, show_threshold
from rarms_iac.model.run import Periodic
from rarms_iac.model.system import Component, run_of
from rarms_iac.providers.cgroups.find_tree import find_tree
from rarms_iac.providers.cgroups.groups import GroupTree
from rarms_iac.statistics.distributions import share_interval
from rarms_iac.statistics.error_probability import ERROR

DOCS = Path(__file__).resolve().parents[2] / "docs"
INTRODUCTION = """\
Written by `make evaluation`, as root, from the real components of `manifests/delivery-robot-linux`: nothing here is
simulated. Reservations are shares of control groups, the interfering load is a busy loop on every processor. The
groups are set by hand and every index is worked out anew, so that this page can contradict `rarms measure`."""
FIGURE_1 = """\
The paper: face detection takes 600 to 800 ms at the low end, falls steeply, and reaches 88 ms at 70 %. FDP and SRP have
task classes, so that they run in SCHED_FIFO with the reservation as their budget on each processor: one thread gets so
much of one processor, as a virtual processor would. VSP and PPP have none, and share. Medians of all runs at a
reservation."""
FOUND = f"""\
*Sweep* is the least whole per cent from which on the medians of all runs meet the APT, found by halving; from ... to
where it was not halved to the end. `rarms measure` saw none of those runs; a setting had up to {MEASURED_S:g} s of a
periodic component's jobs, and {MEASURED_JOBS} of another one's. Its aim is to be at most 2 points away; a setting that
others on the machine disturbed in each of three tries has no verdict, and then it ends above. *Foretold* is what the
simulated host says from a run of the component alone (processor time and waiting time a job), by its mean response
time."""
SPEED = """\
The sweep takes medians; `rarms measure` wants a bound that is wrong in at most 1 of 100 runs, and so ends above it
where response times vary. And the same job takes more or less processor time as the machine's speed changes, while the
two were not run in the same minutes. An earlier run ended up to 13 points above, and found nothing for video-streaming;
longer settings, and judging one in which the machine's speed changed by its quarters, are what brought it nearer.
What a job took, in ms of processor time:"""
FIGURE_3 = """\
One operating system without partitions; stress-ng uses the given share of every processor. FDP and SRP run in
SCHED_FIFO at 30 and 31, VSP and PPP in the ordinary class. The paper: FDP and SRP do not change up to 100 %
utilisation; VSP and PPP degrade above about 70 %."""
FIGURE_4 = """\
FDP in P1 without its class, and headless Chromium in P2, each browser playing a video of its own. The paper: 88 to
100 ms without browsers, up to 184 to 194 ms with one or two, and back down to 150 to 175 ms with ten. Mean response
times. On Linux a browser works in threads of P2, which its weight holds back, so a rise like the paper's is not
expected with one or two; the runs at 50/50 come first, when the browsers have just begun to play."""
TODAY = f"""\
Reservations are often taken from what a component consumes: its 95th or 99th percentile over windows of a second
(usage-based recommenders), or its mean and 20 %; or all get the same. Use was seen without interference. Each
reservation, in whole per cent of the host, then ran {REPEATS} times beside busy loops; *too much* is what it has
beyond the sweep's."""
VERDICTS = f"""\
Each component ran {REPEATS} times for {LONG_S:g} s at {JUDGED[0]} % and at {JUDGED[-1]} %, where all keep up with what
comes (at 10 and 15 % queues grow without end, and there is nothing to judge). Each run is judged as `rarms` judges one,
for each index of its APT {2 * DRAWS} times: with thresholds that are drawn (seeded) to be {NEAREST:g} to {FARTHEST:g}
times what the *other* run showed, and with as many that are too strict by as much. A verdict is wrong where the other
run shows the contrary. Declared is that at most 1 of 100 runs gets a wrong one. Verdicts on the same run are not
independent; the limits take them so. Shorter runs, of 3 to 9 s at more reservations, came first: of what they were
asked, 45 % had no verdict, and 0 of 107 given were wrong; hence the 12 s."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Trial:
    """A way of choosing a reservation: what it chose for a component, and how that did."""

    reserve: int  # per cent of the host
    missed: int  # of `runs`, those in which the APT was not met
    runs: int


@dataclass(frozen=True, slots=True, kw_only=True)
class Findings:
    """Everything that was seen of one component."""

    component: Component
    curve: Mapping[int, Mapping[str, float]]  # by reservation, then index
    too_little: int  # the highest reservation tried, in whole per cent, at which an index is not good enough
    needed: int | None  # the next one that was tried; with it and all above, every index is good enough
    measured: int | None  # what `rarms measure` found
    foretold: int | None  # the same, by the simulated host
    loaded: Mapping[int, float]  # the mean response time in ms, by what the load uses
    trials: Mapping[str, Trial]  # by rule
    work: Mapping[int, Sequence[float]]  # by reservation, of each run: ms of processor time a job


def main() -> None:
    """Write the page and its figures, as far as they are recorded."""
    robot, record = Path(sys.argv[1]).resolve(), Log(path=Path(sys.argv[2]))
    components = components_of(robot, datetime.now(UTC).date())
    found = [_findings(record, component, len(components)) for component in components.values()]
    by_name = {findings.component.name: findings for findings in found}
    browsers = times_with_browsers(record)
    verdicts = count_verdicts(record, components)
    _write(DOCS / "figures" / "linux-figure-1.svg", draw(_chart_1(by_name[FDP])))
    if all(findings.loaded for findings in found):
        _write(DOCS / "figures" / "linux-figure-3.svg", draw(_chart_3(by_name)))
    if browsers:
        _write(DOCS / "figures" / "linux-figure-4.svg", draw(_chart_4(browsers)))
    _write(DOCS / "evaluation.md", "\n".join([*_head(record), *page(found, browsers, verdicts)]))


def page(
    found: Sequence[Findings], browsers: Mapping[tuple[int, int], Sequence[float]], verdicts: VerdictCount
) -> list[str]:
    """Return the lines of the page but its head, which is about this machine; what was not measured is named."""
    by_name = {findings.component.name: findings for findings in found}
    sections = {
        "Fig. 3 (robotic classes under load)": _figure_3(by_name) if all(each.loaded for each in found) else [],
        "Fig. 4 (browsers)": _figure_4(browsers) if browsers else [],
        "what people do today": _comparison(found) if all(each.trials for each in found) else [],
        "verdicts, checked by measuring again": _verdicts(verdicts) if verdicts.judged else [],
    }
    missing = ", ".join(name for name, lines in sections.items() if not lines)
    return [
        *_figure_1(found),
        *_reservations(found),
        *(line for lines in sections.values() for line in lines),
        *(
            [
                "## Not measured yet",
                "",
                f"{missing}.",
                "`make evaluation` goes on with them where its log is, and elsewhere measures everything.",
                "",
            ]
            if missing
            else []
        ),
    ]


def _findings(record: Log, component: Component, components: int) -> Findings:
    name = component.name

    def trial(reserve: int) -> Trial:
        runs = record.runs("reserve", name, reserve)
        missed = sum(not meets(component, values_of(component, run)) for run in runs)
        return Trial(reserve=reserve, missed=missed, runs=len(runs))

    too_little, needed = bracket(record, component)
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
        foretold=_foretold(record, component),
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


def _foretold(record: Log, component: Component) -> int | None:
    alone = record.records[Experiment(kind="alone", component=component.name)]
    arrival = run_of(component).arrival
    demand = demand_of(alone, component.name, 1, float(arrival.period) if isinstance(arrival, Periodic) else 0.0)
    limit = float(component.apt["mean_response_time"].value)
    return foretold(demand, limit, _processors(), in_class=component.task is not None)


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


def _chart_4(browsers: Mapping[tuple[int, int], Sequence[float]]) -> Chart:
    lines = {f"{p1}/{p2}": list(zip(BROWSERS, times, strict=True)) for (p1, p2), times in browsers.items()}
    return Chart(
        title="Face detection beside browsers, by what P1 and P2 reserve (%)",
        across="browsers in P2",
        up="mean response time (ms)",
        lines=lines,
        span=(0, max(BROWSERS)),
        most=100 * -(-max(y for line in lines.values() for _, y in line) // 100),
    )


def _head(record: Log) -> list[str]:
    model = next(
        line.partition(":")[2].strip()
        for line in Path("/proc/cpuinfo").read_text(encoding="utf-8").splitlines()
        if line.startswith("model name")
    )
    memory = os.sysconf("SC_PAGE_SIZE") * os.sysconf("SC_PHYS_PAGES") / 2**30
    tree = find_tree(SLICE)
    version = tree.version if isinstance(tree, GroupTree) else "none"
    others = median(_others(record))
    return [
        "# The delivery robot on a real Linux",
        "",
        INTRODUCTION,
        "",
        f"- Machine: {model}, {_processors()} logical processors, {memory:.1f} GiB.",
        f"- Linux {platform.release()}, control groups {version}, Python {platform.python_version()},",
        f"  {datetime.now(UTC):%Y-%m-%d}.",
        f"- {len(record.records)} experiments, runs of 4 to 12 s. P1 and P2 together got {100 - others:.1f} % of the",
        "  processors in the median run; the rest went to others.",
        "",
    ]


def _others(record: Log) -> Iterator[float]:
    """Of each run beside busy loops, what neither group got, in per cent of the host."""
    for experiment, seen in record.records.items():
        if experiment.kind == "reserve" and len(consumed := seen["consumed"]) > 1:
            (began, *first), (ended, *last) = consumed[0], consumed[-1]
            yield 100 - 100 * (sum(last) - sum(first)) / (ended - began) / _processors()


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


def _reservations(found: Sequence[Findings]) -> list[str]:
    return [
        "## The reservation found",
        "",
        FOUND,
        "",
        _row("component", "APT", "sweep", MEASURED, "apart", "foretold", "apart"),
        "|---|---|---:|---:|---:|---:|---:|",
        *(
            _row(
                findings.component.name,
                ", ".join(
                    f"{index.replace('_', ' ')} {show_threshold(index_named(index), threshold)}"
                    for index, threshold in findings.component.apt.items()
                ),
                _needed(findings),
                "none" if findings.measured is None else f"{findings.measured} %",
                _distance(findings.measured, findings),
                "none" if findings.foretold is None else f"{findings.foretold} %",
                _distance(findings.foretold, findings),
            )
            for findings in found
        ),
        "",
        SPEED,
        "",
        _row("component", "least", "most", "at the sweep's reservation", f"at that of {MEASURED}"),
        "|---|---:|---:|---|---|",
        *(_row(findings.component.name, *_speeds(findings)) for findings in found),
        "",
    ]


def _speeds(findings: Findings) -> Iterator[str]:
    """What a job took in all runs, and in those at the reservations found, in ms of processor time."""
    runs = [work for works in findings.work.values() for work in works]
    yield from (_number(bound(runs, default=inf)) for bound in (min, max))
    for reserve in (findings.needed, findings.measured):
        yield ", ".join(map(_number, findings.work.get(reserve or 0, []))) or "none"


def _distance(reserve: int | None, findings: Findings) -> str:
    """By how many points a reservation is outside of what the sweep found."""
    if reserve is None or findings.needed is None:
        return ""
    least = findings.too_little + 1
    return f"{min(reserve - least, 0) + max(reserve - findings.needed, 0):+} points"


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


def _figure_4(browsers: Mapping[tuple[int, int], Sequence[float]]) -> list[str]:
    return [
        "## Fig. 4: browsers as interference",
        "",
        FIGURE_4,
        "",
        "![Face detection beside browsers](figures/linux-figure-4.svg)",
        "",
        _row("browsers", *(f"{p1}/{p2} (ms)" for p1, p2 in browsers)),
        "|---:|" + "---:|" * len(browsers),
        *(
            _row(str(count), *(_number(times[number]) for times in browsers.values()))
            for number, count in enumerate(BROWSERS)
        ),
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
        "",
    ]


def _rows_of_trials(findings: Findings) -> list[str]:
    return [
        _row(
            findings.component.name,
            _needed(findings),
            rule,
            f"{trial.reserve} %",
            f"{trial.missed} of {trial.runs}",
            "" if findings.needed is None else f"{max(0, trial.reserve - findings.needed)}",
        )
        for rule, trial in findings.trials.items()
    ]


def _needed(findings: Findings) -> str:
    if findings.needed is None:
        return f"more than {max(RESERVES)} %"
    least = findings.too_little + 1
    return f"{findings.needed} %" if least == findings.needed else f"{least} to {findings.needed} %"


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
                f"{sum(trial.missed for trial, _ in trials)} of {sum(trial.runs for trial, _ in trials)}",
                f"{sum(trial.reserve for trial, _ in trials)}",
                f"{sum(max(0, trial.reserve - needed) for trial, needed in trials)}",
            )
        )
    return rows


def _verdicts(count: VerdictCount) -> list[str]:
    lower, upper = share_interval(count.wrong, count.given, error=0.1)
    return [
        "## Verdicts, checked by measuring again",
        "",
        VERDICTS,
        "",
        f"- {count.judged} were asked for, and {count.judged - count.given} "
        f"({100 * (count.judged - count.given) / max(1, count.judged):.1f} %) have no verdict.",
        f"- {count.wrong} of {count.given} are wrong: {100 * lower:.2f} to {100 * upper:.2f} % (one-sided 95 % limits),"
        f" and {100 * ERROR:g} % is declared.",
        "",
    ]


def _number(value: float) -> str:
    return f"{value:.1f}" if isfinite(value) else "none"


def _row(*cells: str) -> str:
    return f"| {' | '.join(cells)} |"


if __name__ == "__main__":
    main()
