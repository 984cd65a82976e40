"""What measuring yields: samples of jobs, a series a component, a setting a reservation (DESIGN section 2)."""

from dataclasses import dataclass


@dataclass(frozen=True, slots=True, kw_only=True)
class Sample:
    """What one job of a component showed."""

    began_ms: float  # since the setting began; of a periodic job, its scheduled start
    response_ms: float | None  # None: no answer
    successful: bool
    count: float = 1.0  # how much it did
    failure: str = ""  # why it is a failed sample (death, time-out, unreadable); empty: it is none


@dataclass(frozen=True, slots=True, kw_only=True)
class Series:
    """All samples of a component at one setting, in the order in which their jobs ended."""

    component: str
    samples: tuple[Sample, ...]
    elapsed_ms: float
    cpu_ms: float | None = None  # processor time that the component consumed; None: cannot be told here


@dataclass(frozen=True, slots=True, kw_only=True)
class Setting:
    """One reservation of the test partition P1 with what was measured there."""

    reserve: int  # CR: per cent of P1's own processors, 1..100
    series: tuple[Series, ...]  # by component name
