"""The loop of measuring: a strategy asks for a setting, the host runs it, samples are judged, the log records it.

A strategy is a pure function of the recorded settings. So whoever is killed goes on by asking it again, and a setting
that is recorded is never run a second time.
"""

from collections.abc import Callable, Mapping, Sequence
from contextlib import ExitStack
from dataclasses import dataclass
from typing import Protocol

from rarms_iac.measuring.loop import MeasuringReporter, watch
from rarms_iac.measuring.partitions import (
    Classes,
    HostBudget,
    PartitionShape,
    memory_for_load,
    reserve_for_load,
    running_test_partitions,
    set_reserves,
    shapes_of_test_partitions,
)
from rarms_iac.measuring.setup import Experiment
from rarms_iac.model.diagnostics import Place
from rarms_iac.model.measurement import P1, P2, Series, Setting
from rarms_iac.model.outcomes import Conclusion, ExperimentStep, Measure, SettingFailed, Stopped, TooManyFailures
from rarms_iac.planner.task_classes import classes_of, registry_values
from rarms_iac.providers.measuring import MeasuringHost, PartitionWork, Work
from rarms_iac.storage.datalog.columns import as_recorded

SETTINGS = 101
"""More than there are settings, so that no two of them share a seed."""


class Strategy(Protocol):
    """Which setting is next; the same settings give the same answer."""

    def step(self, settings: Sequence[Setting]) -> ExperimentStep:
        """What to do after these settings, in the order in which they were run."""
        ...


class SettingsLog(Protocol):
    """Where settings are recorded."""

    def settings(self) -> tuple[Setting, ...]:
        """All that count for this run, in the order in which they were recorded."""
        ...

    def add(self, setting: Setting) -> None:
        """Record one, whole or not at all; it is on the disk when this returns.

        Raises:
            OSError: it cannot be written.
        """
        ...


@dataclass(frozen=True, slots=True, kw_only=True)
class Surroundings:
    """What a run of the loop is given beside the experiment."""

    host: MeasuringHost  # its lock is held by who calls
    room: Callable[[], HostBudget]  # asked once, before the first setting that must be run; may refuse
    seed: int
    reporter: MeasuringReporter
    should_stop: Callable[[], bool]
    others: tuple[PartitionWork, ...] = ()  # what goes on in partitions that run beside P1 and P2, and is not looked at


@dataclass(frozen=True, slots=True, kw_only=True)
class Ended:
    """How it ended, and what that rests on."""

    conclusion: Conclusion
    settings: tuple[Setting, ...]
    new: int  # how many of them were run now


def measure(experiment: Experiment, strategy: Strategy, log: SettingsLog, around: Surroundings) -> Ended:
    """Run settings until the strategy has its answer; P1 and P2 are there only meanwhile.

    Raises:
        HostError: the host did not do what was asked; what is recorded stays.
        OSError: the log cannot be written.
    """
    recorded = settings = log.settings()
    around.reporter.experiment_started(experiment, settings)
    with ExitStack() as ends:
        ends.callback(around.reporter.experiment_ended)
        bench: _Bench | None = None
        while isinstance(step := strategy.step(settings), Measure):
            if around.should_stop():
                step = Stopped()
                break
            bench = bench or _made(experiment, around, ends)
            around.reporter.setting_started(experiment, step.reserve, len(settings) + 1)
            setting = _run(experiment, around, bench, step)
            if not isinstance(setting, Setting):
                step = setting
                break
            log.add(setting)
            settings = (*settings, setting)
            around.reporter.setting_ended(experiment, setting)
    return Ended(conclusion=step, settings=settings, new=len(settings) - len(recorded))


@dataclass(frozen=True, slots=True, kw_only=True)
class _Bench:
    """The test partitions, and what there is room for."""

    room: HostBudget
    shapes: tuple[PartitionShape, PartitionShape]


def _made(experiment: Experiment, around: Surroundings, ends: ExitStack) -> _Bench:
    room = around.room()
    memory = memory_for_load(room, experiment.setup)
    shapes = shapes_of_test_partitions(experiment.setup, room.capacity.logical_processors, memory)
    classes = _classes(experiment)
    ends.enter_context(running_test_partitions(around.host, experiment.application, shapes, classes))
    return _Bench(room=room, shapes=shapes)


def _classes(experiment: Experiment) -> Classes:
    """The task classes that the members name, as a plan would set them in a partition of just these."""
    decided = classes_of(experiment.members, experiment.tasks, P1, NoPlaces()).classes
    return {class_values.name: registry_values(class_values) for class_values in decided}


class NoPlaces:
    """A `Places` for who is told nothing: whoever plans is told of an order that classes cannot express."""

    def value(self, *_path: str | int) -> Place:
        """No place in particular."""
        return Place(file="", line=1, column=1)

    def key(self, *_path: str | int) -> Place:
        """No place in particular."""
        return Place(file="", line=1, column=1)


def _run(
    experiment: Experiment, around: Surroundings, bench: _Bench, asked: Measure
) -> Setting | SettingFailed | Stopped:
    """One setting, from the reserves to the last sample."""
    reserve = asked.reserve
    beside = reserve_for_load(bench.room, experiment.setup, reserve)
    if beside is None:
        raise ValueError(f"{reserve} % was asked for, and the host cannot give that")
    set_reserves(around.host, experiment.application, bench.shapes, {P1: reserve, P2: beside})
    with around.host.run(_work(experiment, around, reserve)) as running:
        seen = watch(running, experiment.members, _looking(experiment, around, asked), around.should_stop)
    match seen:
        case None:
            return Stopped()
        case TooManyFailures(component=component, failures=failures):
            return SettingFailed(reserve=reserve, component=component, failures=failures)
        case _:
            return _setting(reserve, beside, around.seed, seen)


def _looking(experiment: Experiment, around: Surroundings, asked: Measure) -> Callable[[Mapping[str, Series]], bool]:
    def look(seen: Mapping[str, Series]) -> bool:
        around.reporter.looked(experiment, asked.reserve, seen)
        recorded = _setting(asked.reserve, 0, around.seed, seen)
        return asked.settled({series.component: series for series in recorded.series})

    return look


def _setting(reserve: int, beside: int, seed: int, seen: Mapping[str, Series]) -> Setting:
    """What will be recorded: whoever goes on from the log decides by the same numbers."""
    series = tuple(seen[name] for name in sorted(seen))
    return as_recorded(Setting(reserve=reserve, series=series, beside=beside, seed=seed))


def _work(experiment: Experiment, around: Surroundings, reserve: int) -> Work:
    """Chance is drawn anew for each setting: what two of them have in common is not an accident of one."""
    return Work(
        application=experiment.application,
        inside=(
            PartitionWork(partition=P1, components=experiment.members),
            PartitionWork(partition=P2, load=experiment.load),
            *around.others,
        ),
        until={name: run.until for name, run in experiment.runs.items()},
        seed=around.seed * SETTINGS + reserve,
    )
