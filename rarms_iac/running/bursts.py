"""An interfering load that bursts: processes that wake together, use processor time and sleep. A program of its own.

Arguments: how many processes, the processor time of a burst on each, and the gap between bursts on average, both in ns.
Writes `running` once all of them are there. With `one NUMBER BURST` it is one of these processes: on standard input it
it receives the times to wake, and on standard output it says when its burst is done.
"""

import os
import random
import struct
import subprocess
import sys
import time

MOMENT = struct.Struct("q")
"""A time of `perf_counter_ns`, which all processes of a machine share."""

SHORTEST_GAP, LONGEST_GAP = 0.5, 1.5
"""As `model/loads.py` has them: this program imports nothing of the package."""


def main(words: list[str]) -> int:
    """Run as the process that wakes the others, or as one of these."""
    if words[0] == "one":
        return burst_when_told(int(words[1]), int(words[2]))
    return wake_together(*map(int, words))


def wake_together(count: int, burst_ns: int, gap_ns: int) -> int:
    """Have all of them burst at the same moment; the next gap begins when the last of them is done."""
    own = [sys.executable, "-I", "-S", __file__, "one"]
    threads = [
        subprocess.Popen([*own, str(number), str(burst_ns)], stdin=subprocess.PIPE, stdout=subprocess.PIPE, bufsize=0)
        for number in range(count)
    ]
    if not all_answer(threads):
        return 1
    sys.stdout.write("running\n")
    sys.stdout.flush()
    gaps = random.Random()  # noqa: S311 - gaps that lock into no phase are the purpose, not a secret
    while True:
        wake = time.perf_counter_ns() + round(gap_ns * gaps.uniform(SHORTEST_GAP, LONGEST_GAP))
        if not (all_are_told(threads, wake) and all_answer(threads)):
            sys.stderr.write("a process of the bursts ended\n")
            return 1


def all_are_told(threads: "list[subprocess.Popen[bytes]]", wake: int) -> bool:
    """Tell each when to wake, by the clock of `perf_counter_ns`; False where one has ended."""
    try:
        for thread in threads:
            assert thread.stdin is not None
            thread.stdin.write(MOMENT.pack(wake))
    except OSError:  # EPIPE; EINVAL on Windows
        return False
    return True


def all_answer(threads: "list[subprocess.Popen[bytes]]") -> bool:
    """Wait for a byte of each; False where one has ended."""
    return all(thread.stdout is not None and thread.stdout.read(1) for thread in threads)


def burst_when_told(number: int, burst_ns: int) -> int:
    """Wake on request, and use so much processor time, even if others use the processor meanwhile."""
    if hasattr(os, "sched_setaffinity"):
        processors = sorted(os.sched_getaffinity(0))
        os.sched_setaffinity(0, [processors[number % len(processors)]])
    os.write(1, b".")
    while len(moment := os.read(0, MOMENT.size)) == MOMENT.size:
        (wake,) = MOMENT.unpack(moment)
        while (remaining := wake - time.perf_counter_ns()) > 0:
            time.sleep(remaining / 1e9)
        end = time.thread_time_ns() + burst_ns
        while time.thread_time_ns() < end:
            pass
        os.write(1, b".")
    return 0


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
