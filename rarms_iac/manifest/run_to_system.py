"""`run` of a component -> Run of the System."""

from rarms_iac.manifest.document.run import (
    EveryBlock,
    FieldBlock,
    FromEnvironmentBlock,
    RunBlock,
    SamplesBlock,
    StopBlock,
    TimeFieldBlock,
    UntilBlock,
)
from rarms_iac.model.quantities import UNITS, Unit
from rarms_iac.model.system import (
    Call,
    Closed,
    Command,
    Elapsed,
    Field,
    FromEnvironment,
    Periodic,
    Run,
    SampleCount,
    Samples,
    Stop,
)

_CLOSED = Closed()
_PER_RUN = Samples(source="per_run")
_STOP = Stop()
_UNTIL = SampleCount(samples=200)


def to_run(block: RunBlock) -> Run:
    """How a component is run; the deadline of a periodic job is its period unless it says otherwise."""
    arrival = _arrival(block.arrival)
    deadline = block.deadline
    if deadline is None and isinstance(arrival, Periodic):
        deadline = arrival.period
    return Run(
        start=_start(block),
        files=tuple(block.files or ()),
        environment={name: _variable(value) for name, value in (block.environment or {}).items()},
        folder=block.folder,
        until=_until(block.until) if block.until else _UNTIL,
        timeout=block.timeout,
        stop=_stop(block.stop) if block.stop else _STOP,
        arrival=arrival,
        samples=_samples(block.samples) if block.samples else _PER_RUN,
        deadline=deadline,
        failures=block.failures,
    )


def _start(block: RunBlock) -> Command | Call:
    if block.call is None:
        return Command(words=tuple(block.command or ()))
    module, _, function = block.call.partition(":")
    return Call(module=module, function=function)


def _variable(value: str | FromEnvironmentBlock) -> str | FromEnvironment:
    return value if isinstance(value, str) else FromEnvironment(name=value.from_env)


def _until(block: UntilBlock) -> SampleCount | Elapsed:
    if block.elapsed is not None:
        return Elapsed(time=block.elapsed)
    return _UNTIL if block.samples is None else SampleCount(samples=block.samples)


def _stop(block: StopBlock) -> Stop:
    return Stop(signal=block.signal, grace=block.grace)


def _arrival(value: str | EveryBlock | None) -> Closed | Periodic:
    return Periodic(period=value.every) if isinstance(value, EveryBlock) else _CLOSED


def _samples(block: SamplesBlock) -> Samples:
    return Samples(
        source=block.source,
        pattern=block.pattern or "",
        response_time=_time_field(block.response_time),
        success=_field(block.success),
        count=_field(block.count),
    )


def _time_field(block: TimeFieldBlock | None) -> Field | None:
    return None if block is None else Field(name=block.field, factor=UNITS[Unit.TIME][block.unit])


def _field(block: FieldBlock | None) -> Field | None:
    return None if block is None else Field(name=block.field)
