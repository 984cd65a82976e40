"""Processor time consumed next to what is reserved, on control groups of this machine: `-m benchmarks.linux.shares`.

Two groups with a busy loop on each processor want everything: P1 with the reserve, P2 with the rest. Under `share` the
weights divide; under `quota` P1 has a limit besides. Needs root. Figures are points of the host; the median of the runs
counts, and what both groups together did not get is printed, since on a busy machine that is the error.
"""

import os
import statistics
import sys
import time
from pathlib import Path

from rarms_iac.model.loads import BusyLoop
from rarms_iac.providers.cgroups.groups import GroupTree, GroupValues
from rarms_iac.providers.cgroups.trees import find_tree
from rarms_iac.running.loads import InterferingLoad
from rarms_iac.running.orders import StartContext

RESERVES = (5, 20, 35, 50, 65, 80, 95)
RUNS = 5
SETTLE_S, RUN_S = 0.5, 2.0
PERIOD_US = 20_000
GOALS = {"share": 1.0, "quota": 0.5}
"""The most, in points of the host, that the median may be away from the reserve."""

QUIET = 1.0
"""Per cent of the host. Where both groups together did not get more than this, others used the machine: shares are then
judged by what both got, since no weight promises what is not there."""


def main() -> int:
    """Print a line for each reserve and mechanism; 1 where a goal is missed."""
    tree = find_tree(f"rarms-benchmark-{os.getpid()}")
    if not isinstance(tree, GroupTree):
        print(f"Control groups lack: {'; '.join(tree.names)}")
        return 1
    print(f"{os.cpu_count()} processors, control groups {tree.version}, medians of {RUNS} runs of {RUN_S:g} s")
    try:
        for name in ("p1", "p2"):
            tree.make(name)
        os.sched_setscheduler(0, os.SCHED_FIFO, os.sched_param(1))
        p1, p2 = (StartContext(base=Path(), inside=tree.place(name)) for name in ("p1", "p2"))
        with InterferingLoad("p1", BusyLoop(), p1), InterferingLoad("p2", BusyLoop(), p2):
            return sum(missed(tree, mechanism, reserve) for mechanism in GOALS for reserve in RESERVES) and 1
    finally:
        for name in tree.names():
            tree.remove(name)


def missed(tree: GroupTree, mechanism: str, reserve: int) -> bool:
    """Measure and print one reserve; whether its goal is missed."""
    processors = os.cpu_count() or 1
    quota = reserve * processors if mechanism == "quota" else None
    weight = reserve if quota is None else 2000  # what the limit alone is to hold back must not lack weight
    tree.write("p1", GroupValues(shares_percent=weight * processors, quota_percent=quota, period_us=PERIOD_US))
    tree.write("p2", GroupValues(shares_percent=(100 - reserve) * processors))
    runs = [run_once(tree, processors) for _ in range(RUNS)]
    consumed, others = (statistics.median(column) for column in zip(*runs, strict=True))
    is_busy = mechanism == "share" and others > QUIET
    error = (100 * consumed / (100 - others) if is_busy else consumed) - reserve
    basis = "of what both got" if is_busy else "of the host"
    verdict = "ok" if abs(error) <= GOALS[mechanism] else f"more than {GOALS[mechanism]:g}"
    print(
        f"{mechanism}  {reserve:3} %  {consumed:6.2f} %  {error:+5.2f} points {basis}  {verdict}"
        f"  (others {others:.2f} %)",
        flush=True,
    )
    return verdict != "ok"


def run_once(tree: GroupTree, processors: int) -> tuple[float, float]:
    """Return what P1 consumed, and what neither group did, in per cent of the host."""
    time.sleep(SETTLE_S)
    before, started = [tree.cpu_ms(name) for name in ("p1", "p2")], time.perf_counter()
    time.sleep(RUN_S)
    whole = 1000 * (time.perf_counter() - started) * processors
    p1, p2 = (100 * (tree.cpu_ms(name) - was) / whole for name, was in zip(("p1", "p2"), before, strict=True))
    return p1, 100 - p1 - p2


if __name__ == "__main__":
    sys.exit(main())
