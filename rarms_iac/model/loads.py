"""Interfering loads: what runs in P2 while a component is measured in P1, and those that need no entry."""

from collections.abc import Mapping
from dataclasses import dataclass
from fractions import Fraction
from typing import Annotated, ClassVar, assert_never

from rarms_iac.model.keys import Filled, Form, Key, PositiveTime, Quantity, Within
from rarms_iac.model.quantities import Milliseconds, Percent, Unit

_THREADS = Key("The number of threads or workers; absent: one for each logical processor.")
_INSTANCES = Key("The number of instances that run at once.")
Threads = Annotated[int | None, Within(1, 4096), _THREADS]
Instances = Annotated[int, Within(1, 1000), _INSTANCES]


@dataclass(frozen=True, slots=True, kw_only=True)
class BusyLoop:
    """Threads that never wait (BLP)."""

    kind: ClassVar[str] = "busy_loop"
    threads: Threads = None


@dataclass(frozen=True, slots=True, kw_only=True)
class Browser:
    """Browsers that stream video. Their interrupts have priority over all threads."""

    kind: ClassVar[str] = "browser"
    instances: Instances = 1


@dataclass(frozen=True, slots=True, kw_only=True)
class CommandLoad:
    """Any other program."""

    kind: ClassVar[str] = "command"
    command: Annotated[Filled[tuple[str, ...]], Key("The program and its arguments, each word an item.")]
    instances: Instances = 1


@dataclass(frozen=True, slots=True, kw_only=True)
class Stress:
    """Workers of stress-ng, which must be installed."""

    kind: ClassVar[str] = "stress"
    stressor: Annotated[
        str,
        Form.STRESSOR,
        Key(
            "The stressor, by its name in `stress-ng --stressors`: `timer` (interrupts), `hdd` (disk), "
            "`stream` (memory bandwidth), `switch` (context switches), `sock` (soft interrupts of the "
            "network)."
        ),
    ]
    workers: Threads = None


@dataclass(frozen=True, slots=True, kw_only=True)
class Bursts:
    """Threads that sleep, then all wake together and use the processor time that their partition saved.

    A burst is `every` x `duty` of processor time on each thread. The gap to the next one is drawn from 0.5 to 1.5 of
    `every` x (1 - `duty`), however long the burst took, so that no phase lasts.
    """

    kind: ClassVar[str] = "bursts"
    every: Annotated[PositiveTime, Key("The mean time between the starts of two bursts without delays: `50 ms`.")]
    duty: Annotated[
        Percent | None,
        Quantity(kinds=(Unit.SHARE,), positive=True, most="100 %"),
        Key("The part of the period that each thread uses as processor time; absent: the reservation of P2."),
    ] = None
    threads: Threads = None

    def cycle(self, reserve_percent: float) -> "Cycle":
        """Return burst and gap for what its partition reserves.

        Args:
            reserve_percent: of each processor of its partition; below 1 counts as 1, since a burst takes some time.

        Returns:
            Both in ms.
        """
        duty = Fraction(max(1.0, reserve_percent) if self.duty is None else self.duty) / 100
        return Cycle(burst_ms=float(self.every * duty), gap_ms=float(self.every * max(Fraction(0), 1 - duty)))


SHORTEST_GAP, LONGEST_GAP = 0.5, 1.5
"""Between these multiples of a cycle's gap the gaps between bursts are drawn, evenly."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Cycle:
    """The average activity of each thread of a load that bursts."""

    burst_ms: float  # of processor time
    gap_ms: float  # between the end of a burst and the next one


Interference = BusyLoop | Bursts | CommandLoad | Stress | Browser


def is_steady(load: Interference) -> bool:
    """Tell whether a load never sleeps by design, so that it saves up no claim.

    Args:
        load: of a program of which nothing is known it is taken for granted.

    Returns:
        False for bursts with gaps, and for browsers.
    """
    match load:
        case BusyLoop() | CommandLoad() | Stress():
            return True
        case Bursts(duty=duty):
            return duty is not None and duty >= 100
        case Browser():
            return False
        case _:
            assert_never(load)


LONG_CYCLE = Milliseconds(Fraction(100))
"""Bursts with this period or a longer one are divided: the window that a scheduler remembers."""


def load_parts(load: Interference, processors: int) -> int:
    """Return the most partitions in which a load interferes.

    Args:
        processors: LPs of the host.

    Returns:
        What the manifest counts exists once. Others have equal parts, and one more on the LPs without a VP of P1.
    """
    match load:
        case BusyLoop(threads=None) | Bursts(duty=None, threads=None) if processors > 1:
            return equal_parts(load) + 1
        case _:
            return 1


def equal_parts(load: Interference) -> int:
    """Return the number of partitions that divide a load evenly: 2 where waits are then more frequent.

    With one neighbor a component that competes for several processors waits seldom and long. With several it waits two
    to four times as often, so that percentiles of short jobs are longer, although the mean is the same. Short bursts
    stay in one partition: they delay a mean most where they take all processors at once (docs/measuring.md, Loads).
    """
    return 1 if isinstance(load, Bursts) and load.every < LONG_CYCLE else 2


def could_take_all(load: Interference, processors: int) -> bool:
    """Tell whether a load could take all that P2 reserves, by what it is.

    Args:
        load: of a program of which nothing is known it is taken for granted; what was seen of it may say otherwise.

    Returns:
        False for fewer threads than processors, for bursts of a fixed duty, and for browsers.
    """
    match load:
        case BusyLoop(threads=threads) | Stress(workers=threads):
            return threads is None or threads >= processors
        case Bursts(duty=duty, threads=threads):
            return (threads is None or threads >= processors) and (duty is None or duty >= 100)
        case CommandLoad():
            return True
        case Browser():
            return False
        case _:
            assert_never(load)


BUSY_LOOP = "busy-loop"

PERIODS_MS = (5, 10, 20, 50, 100, 200)
"""Of the bursts that need no entry."""

HALF = Percent(Fraction(50))


def _loads_without_entry() -> dict[str, Interference]:
    loads: dict[str, Interference] = {BUSY_LOOP: BusyLoop()}
    for period in PERIODS_MS:
        every = Milliseconds(Fraction(period))
        loads[f"bursts-{period}"] = Bursts(every=every)
        loads[f"bursts-{period}-half"] = Bursts(every=every, duty=HALF)
    return loads


LOADS_WITHOUT_ENTRY: Mapping[str, Interference] = _loads_without_entry()
"""What a manifest may name without describing it; an entry of the same name stands instead."""

MOST_HARMFUL_MS = 20
"""The period of the bursts that decide most often, of the loads that need no entry (docs/measuring.md)."""


def load_of_first_pass(loads: Mapping[str, Interference]) -> str:
    """Choose the load of the first pass: the one that most probably decides a reservation.

    Args:
        loads: Those of the policy by name, at least one.

    Returns:
        The bursts that take all their partition reserves and whose period is nearest to `MOST_HARMFUL_MS`, by its
            ratio; without such the first that is not a busy loop, or else the first.
    """
    bursts = {
        name: max(load.every / MOST_HARMFUL_MS, MOST_HARMFUL_MS / load.every)
        for name, load in loads.items()
        if isinstance(load, Bursts) and load.duty is None
    }
    if bursts:
        return min(bursts, key=lambda name: bursts[name])
    return next((name for name, load in loads.items() if not isinstance(load, BusyLoop)), next(iter(loads)))


DEFAULT_LOADS = (BUSY_LOOP, "bursts-20", "bursts-100")
"""The loads under which a reservation must hold if the manifest names none."""
