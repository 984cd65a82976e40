"""Small real components for the tests: Python programs, and the `run` that starts them."""

import sys
from collections.abc import Iterable, Mapping
from fractions import Fraction
from pathlib import Path

import pytest

from rarms_iac.model.quantities import Milliseconds
from rarms_iac.model.run import (
    Call,
    Closed,
    Elapsed,
    FromEnvironment,
    Periodic,
    Run,
    SampleCount,
    Samples,
    Stop,
    TimeField,
)
from rarms_iac.model.series import Sample
from rarms_iac.running.component import ComponentRun
from rarms_iac.running.orders import StartContext

PER_RUN = Samples(source="per_run")
JSON_LINES = Samples(source="json_lines", response_time=TimeField(field="ms", unit="ms"))
same_everywhere = pytest.mark.needs("posix")
"""For what does not depend on the system: a start takes seconds on the Windows that tests run on."""

HEARD = "import sys, time, json, os, signal\ndef say(text): print(text, flush=True)\n"
"""What every program begins with."""


def ms(value: float) -> Milliseconds:
    return Milliseconds(Fraction(value))


def a_run(
    program: str | Call | tuple[str, ...],
    *,
    samples: Samples = JSON_LINES,
    until: int | float = 3,
    every: float | None = None,
    timeout: float = 20_000,
    failures: int = 0,
    stop: Stop | None = None,
    environment: Mapping[str, str | FromEnvironment] | None = None,
    folder: str = ".",
) -> Run:
    """A `run`: Python text, words or a function; `until` is a count, or milliseconds where it is not a whole number."""
    call, words = (f"{program.module}:{program.function}", ()) if isinstance(program, Call) else ("", program)
    return Run(
        command=(sys.executable, "-S", "-c", HEARD + words) if isinstance(words, str) else words,
        call=call,
        environment=environment or {},
        folder=folder,
        until=SampleCount(samples=until) if isinstance(until, int) else Elapsed(time=ms(until)),
        timeout=ms(timeout),
        stop=stop or Stop(grace=ms(2000)),
        arrival=Closed() if every is None else Periodic(period=ms(every)),
        samples=samples,
        failures=failures,
    )


def component(run: Run, base: Path, environment: Mapping[str, str] | None = None) -> ComponentRun:
    around = StartContext(base=base) if environment is None else StartContext(base=base, environment=dict(environment))
    return ComponentRun("vision", run, around)


def all_of(run: Run, base: Path) -> list[Sample]:
    """Every sample, the run being over and closed."""
    with component(run, base) as component_run:
        return list(component_run)


def responses(samples: Iterable[Sample]) -> list[float | None]:
    return [sample.response_ms for sample in samples]


def failures(samples: Iterable[Sample]) -> list[str]:
    return [sample.failure for sample in samples if sample.failure]
