"""Paired timing: what is compared runs in turn, so that a busy machine slows both sides alike.

What a command consumes is counted on POSIX only: Windows counts neither processor time nor memory for a process itself.

A benchmark gathers `Figure`s and ends with `sys.exit(report(figures))`.
"""

import os
import statistics
import subprocess
import sys
import time
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path

Task = Callable[[], object]


@dataclass(frozen=True, slots=True, kw_only=True)
class Figure:
    """One measured number next to its goal; without a goal it is only told."""

    name: str
    value: float
    unit: str = "x"
    at_most: float | None = None

    @property
    def reached(self) -> bool:
        return self.at_most is None or self.value <= self.at_most


def command(words: Sequence[str], *, environment: Mapping[str, str] | None = None, expect: int = 0) -> Task:
    """Return a task that runs a whole command, its output unread; another exit code than `expect` is an error."""

    def run() -> None:
        done = subprocess.run(
            words,
            env={**os.environ, **(environment or {})},
            stdin=subprocess.DEVNULL,
            stdout=subprocess.DEVNULL,
            stderr=subprocess.DEVNULL,
            check=False,
        )
        if done.returncode != expect:
            raise RuntimeError(f"{' '.join(words)} ended with exit code {done.returncode} instead of {expect}")

    return run


def seconds(task: Task) -> float:
    """Wall time of one run."""
    begun = time.perf_counter()
    task()
    return time.perf_counter() - begun


COUNTED = """
import resource, sys
from rarms_iac.cli.main import main
code = main(sys.argv[1:])
used = resource.getrusage(resource.RUSAGE_SELF)
sys.stderr.write(f"\\n{used.ru_utime} {used.ru_stime} {used.ru_maxrss}")
sys.exit(code)
"""


def consumed(folder: Path, *words: str, expect: int = 0) -> tuple[float, float]:
    """One run of `rarms`: its processor time in seconds, start-up and all, and its peak of resident memory in MiB.

    NOTE: not the time that passes: the command does one thing at a time, and other programs would be counted in.
    """
    done = subprocess.run(
        [sys.executable, "-c", COUNTED, *words],
        cwd=folder,
        env={**os.environ, "PYTHONPATH": str(Path(__file__).parents[2])},
        stdin=subprocess.DEVNULL,
        capture_output=True,
        encoding="utf-8",
        check=False,
    )
    if done.returncode != expect:
        raise RuntimeError(f"rarms {' '.join(words)} ended with exit code {done.returncode}: {done.stderr[-2000:]}")
    user, system, kibibytes = map(float, done.stderr.rpartition("\n")[2].split())
    return user + system, kibibytes / 1024


def interleaved(tasks: Mapping[str, Task], *, rounds: int) -> dict[str, list[float]]:
    """Wall times in seconds of `rounds` runs of every task, after one that warms up: in turn, odd rounds backwards."""
    times: dict[str, list[float]] = {name: [] for name in tasks}
    for task in tasks.values():
        task()
    for number in range(rounds):
        names = list(tasks) if number % 2 == 0 else list(reversed(list(tasks)))
        for name in names:
            times[name].append(seconds(tasks[name]))
    return times


def median_ratio(times: Sequence[float], to: Sequence[float]) -> float:
    """Return the median of the ratios of runs that were neighbours in time."""
    return statistics.median(time / other for time, other in zip(times, to, strict=True))


def table(figures: Sequence[Figure]) -> str:
    """Return the figures as a text table, a line each."""
    rows = [("", "measured", "goal", "")]
    for figure in figures:
        goal = "-" if figure.at_most is None else f"<= {figure.at_most:g} {figure.unit}"
        rows.append((figure.name, f"{figure.value:.3g} {figure.unit}", goal, "" if figure.reached else "MISSED"))
    widths = [max(len(row[column]) for row in rows) for column in range(4)]
    aligned = (
        f"{name:<{widths[0]}}  {value:>{widths[1]}}  {goal:<{widths[2]}}  {word}" for name, value, goal, word in rows
    )
    return "\n".join(line.rstrip() for line in aligned)


def report(figures: Sequence[Figure]) -> int:
    """Print the table; 1 when a goal was missed, otherwise 0."""
    print(table(figures))
    return 0 if all(figure.reached for figure in figures) else 1


def commit() -> str:
    """Return the id of the checkout's last commit."""
    words = ["git", "rev-parse", "HEAD"]
    return subprocess.run(words, cwd=Path(__file__).parent, capture_output=True, text=True, check=True).stdout.strip()
