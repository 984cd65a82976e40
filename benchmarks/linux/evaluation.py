"""Measures the Linux delivery robot on this machine, as root, for `benchmarks.linux.page`.

Usage: python -m benchmarks.linux.evaluation FOLDER-OF-THE-ROBOT LOG [SECONDS]

LOG holds what is done already. After SECONDS (none: never) it ends with exit code 3 where there is more to do.
"""

import os
import signal
import sys
import time
from collections.abc import Iterator, Mapping
from datetime import UTC, date, datetime
from math import ceil
from pathlib import Path
from statistics import fmean

from benchmarks.linux.experiments import Experiment, Log, meets, percentile, usage, values_in, workbench
from rarms_iac.manifest.load import load_system
from rarms_iac.model.system import Component

FDP, SRP, PPP, VSP = "face-detection", "speech-recognition", "path-planning", "video-streaming"
RESERVES = (10, 15, 20, 30, 50, 80)

LOADS = (0, 25, 50, 75, 100)
BROWSERS = (0, 1, 2, 5, 10)
PRIORITIES: Mapping[str, int | None] = {FDP: 30, SRP: 31, VSP: None, PPP: None}
REPEATS = 2
MEASURED = "`rarms measure`"
LONGEST_S = 240.0
"""What `rarms measure` takes at most."""


def main() -> int:
    """Do what is not done yet."""
    signal.signal(signal.SIGTERM, lambda *_: sys.exit(143))  # its control groups go, too
    robot, log = Path(sys.argv[1]).resolve(), Log(path=Path(sys.argv[2]))
    ends = time.monotonic() + (float(sys.argv[3]) if len(sys.argv) > 3 else 1e9)
    components = components_of(robot, datetime.now(UTC).date())
    processors = len(os.sched_getaffinity(0))
    with workbench(robot, os.environ, processors) as machine:
        while (experiment := next_experiment(log, components, processors)) is not None:
            if time.monotonic() + {"measured": LONGEST_S, "browsers": 100.0}.get(experiment.kind, 30.0) > ends:
                print(f"{len(log.records)} experiments are recorded; go on with the same command", file=sys.stderr)
                return 3
            print(experiment, file=sys.stderr, flush=True)
            component = components[experiment.component]
            log.add(experiment, machine.perform(experiment, component, PRIORITIES[component.name]))
    return 0


def components_of(robot: Path, today: date) -> Mapping[str, Component]:
    """Return the components of the manifest in a folder, by name."""
    system = load_system(str(robot / "rarms.yaml"), today=today).system
    assert system is not None
    return system.components


def next_experiment(log: Log, components: Mapping[str, Component], processors: int) -> Experiment | None:
    """Return the first experiment that is not recorded; None: all are."""
    return next((each for each in _experiments(log, components, processors) if each not in log.records), None)


def _experiments(log: Log, components: Mapping[str, Component], processors: int) -> Iterator[Experiment]:
    """All experiments, those that depend on others as soon as these are recorded."""
    for name in components:
        yield Experiment(kind="alone", component=name)
        for reserve in RESERVES:
            yield Experiment(kind="reserve", component=name, setting=reserve)
    for name in components:
        for percent in LOADS:
            yield Experiment(kind="class", component=name, setting=percent)
    for browsers in BROWSERS:
        yield Experiment(kind="browsers", component=FDP, setting=browsers)
    for name in components:
        yield Experiment(kind="measured", component=name)
    for component in components.values():
        yield from _narrowing(log, component)
        for reserve in rules(log, component, processors, len(components)).values():
            yield from _repeated(component.name, reserve)


def _repeated(name: str, reserve: int) -> Iterator[Experiment]:
    for repeat in range(1, REPEATS + 1):
        yield Experiment(kind="reserve", component=name, setting=reserve, repeat=repeat)


def _narrowing(log: Log, component: Component) -> Iterator[Experiment]:
    """Halve what lies between too little and enough, each setting in several runs, until a single point is left."""
    below, enough = bracket(log, component)
    while enough is not None and enough - below > 1:
        yield from _repeated(component.name, (below + enough) // 2)
        below, enough = bracket(log, component)
    if enough is not None:
        yield from _repeated(component.name, enough)


def bracket(log: Log, component: Component) -> tuple[int, int | None]:
    """Between what reservations the least one lies from which on the medians of all runs meet the APT.

    Returns:
        The highest that does not, 0 where all do; and the next one that was tried, None where there is none.
    """
    reserves = {each.setting for each in log.records if (each.kind, each.component) == ("reserve", component.name)}
    enough = None
    for reserve in sorted(reserves, reverse=True):
        if not meets(component, values_in(log.runs("reserve", component.name, reserve), component)):
            return reserve, enough
        enough = reserve
    return 0, enough


def rules(log: Log, component: Component, processors: int, components: int) -> dict[str, int]:
    """Return what each way of choosing a reservation gives a component, in whole per cent of the host."""
    used = usage(log.records[Experiment(kind="alone", component=component.name)], processors)
    measured = log.records[Experiment(kind="measured", component=component.name)]["reserve"]
    chosen = {
        MEASURED: measured,
        "95th percentile of use": percentile(used, 95),
        "99th percentile of use": percentile(used, 99),
        "mean of use and 20 %": 1.2 * fmean(used),
        "even split": 100 / components,
    }
    return {rule: min(99, max(1, ceil(reserve))) for rule, reserve in chosen.items()}


if __name__ == "__main__":
    sys.exit(main())
