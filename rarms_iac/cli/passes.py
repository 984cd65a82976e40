"""Measuring once more (`--again`): each log says which pass is not ended, so that the same command goes on with it."""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import replace
from datetime import UTC, datetime
from pathlib import Path

from rarms_iac.app.hosts import Hosts
from rarms_iac.cli.books import Kept, kept
from rarms_iac.cli.experiments import MeasureOptions
from rarms_iac.cli.locks import held_log
from rarms_iac.measuring.setup import Experiment
from rarms_iac.providers.measuring import MeasuringHost
from rarms_iac.storage.datalog.files import append_remeasurement, begin_log
from rarms_iac.storage.datalog.log import Remeasurement


def passes_for(
    hosts: Hosts,
    experiments: Sequence[Experiment],
    benches: Mapping[str, MeasuringHost],
    options: MeasureOptions,
    refuse: Callable[[Experiment], None],
) -> Mapping[Path, Remeasurement]:
    """By data log the pass that is to be measured: one that is not ended, or a new one, which all logs say then.

    A command that was killed goes on: its other logs say whether they had their turn. `refuse` raises where an
    experiment cannot be run; nothing is written then.

    Raises:
        UseCaseError: a log is damaged (4), or held by another run (3).
    """
    known = [kept(hosts, one, benches[one.host.name]) for one in experiments]
    asked = asked_for(options)
    unfinished = [last for one in known if (last := _last(one, asked)) is not None and not last.ended]
    begun = max((remeasurement.begun for remeasurement in unfinished), default=None)
    found = {one.path: _of_that_command(one, asked, begun) for one in known}
    for experiment, one in zip(experiments, known, strict=True):
        if found[one.path] is None:
            refuse(experiment)
    started = begun or datetime.now(UTC).isoformat(timespec="microseconds")
    return {one.path: found[one.path] or _begin(hosts, one, asked, started, options) for one in known}


def end_passes(hosts: Hosts, complete: Mapping[Path, Remeasurement], options: MeasureOptions) -> None:
    """Record in each log that all of its pass is measured.

    Raises:
        UseCaseError: a log is held by another run (3).
    """
    for path, one in complete.items():
        if not one.ended:
            with held_log(Path(hosts.folder), path, options.lock_timeout_ms):
                append_remeasurement(path, replace(one, ended=True))


def asked_for(options: MeasureOptions) -> str:
    """What tells a command from others of the same components, in words."""
    what = options.strategy
    if options.reserves:
        what = ", ".join(f"{reserve} %" for reserve in options.reserves)
    elif options.verify:
        what = "verify"
    return what if options.samples is None else f"{what}; {options.samples} samples"


def _last(kept: Kept, asked: str) -> Remeasurement | None:
    passes = () if kept.holds is None else kept.holds.remeasurements
    return next((each for each in reversed(passes) if each.asked == asked), None)


def _of_that_command(kept: Kept, asked: str, begun: str | None) -> Remeasurement | None:
    """The pass that a command has in this log which began then; one that is not ended is gone on with in any case."""
    last = _last(kept, asked)
    if begun is None or last is None or (last.ended and last.begun != begun):
        return None
    return last


def _begin(hosts: Hosts, kept: Kept, asked: str, begun: str, options: MeasureOptions) -> Remeasurement:
    begins = Remeasurement(seed=1 if kept.holds is None else kept.holds.highest_seed + 1, asked=asked, begun=begun)
    with held_log(Path(hosts.folder), kept.path, options.lock_timeout_ms):
        if kept.holds is None:
            begin_log(kept.path, kept.header)
        append_remeasurement(kept.path, begins)
    return begins
