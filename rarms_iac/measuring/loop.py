"""The loop of measuring: a strategy asks for a setting, it is run (`setting_run`), and the log records it.

A strategy is a pure function of the recorded settings, so a run that was killed goes on by asking it again. It asks for
a recorded setting again only where that is not finished, or where all is to be measured anew (`--again`).
"""

from contextlib import ExitStack
from dataclasses import dataclass

from rarms_iac.measuring.search.trials import conclude
from rarms_iac.measuring.setting_run import (
    MeasuringContext,
    TestPartitions,
    make_test_partitions,
    other_processors,
    run_setting,
)
from rarms_iac.measuring.settings_log import KnownSettings, SettingsLog
from rarms_iac.measuring.strategies import SettingCount, Strategy, goal_of
from rarms_iac.model.experiment import Experiment
from rarms_iac.model.outcomes import Conclusion, Measure, Stopped
from rarms_iac.model.setting import Setting


@dataclass(frozen=True, slots=True, kw_only=True)
class ProcessorNumberChanged:
    """P1 was seen to use another number of processors than it has: what was measured so far is no curve of it."""

    number: int


@dataclass(frozen=True, slots=True, kw_only=True)
class LoopResult:
    """How an experiment ended, and what that rests on."""

    conclusion: Conclusion | ProcessorNumberChanged
    settings: tuple[Setting, ...]
    new: int  # how many of them were run now


def measure_settings(
    experiment: Experiment,
    strategy: Strategy,
    log: SettingsLog,
    context: MeasuringContext,
    *,
    count: SettingCount | None = None,
) -> LoopResult:
    """Run settings until the strategy has its answer; P1 and P2 are there only meanwhile.

    Args:
        experiment: what is measured.
        strategy: asked for each next setting.
        log: its settings count as known; new ones are added as they end.
        context: the host, locked, and who is told.
        count: after `count.most` new settings the loop ends with what they show; both numbers say how long is left.
            None: as many settings as the strategy asks for.

    Returns:
        How it ended, with all settings that count.

    Raises:
        HostError: the host did not do what was asked; what is recorded stays.
        OSError: the log cannot be written.
    """
    known, new = KnownSettings(runs=log.runs(), simulated=log.is_simulated), 0
    seed, times = log.remeasure_seed, context.wall_times

    def ended(conclusion: Conclusion | ProcessorNumberChanged) -> LoopResult:
        return LoopResult(conclusion=conclusion, settings=known.settings, new=new)

    context.reporter.experiment_started(experiment, known.settings)
    with ExitStack() as ends:
        ends.callback(context.reporter.experiment_ended)
        partitions: TestPartitions | None = None
        while True:
            decision = strategy.decide(known.seen_with(seed))
            if not isinstance(decision, Measure):
                if seed is None:
                    return ended(decision)
                seed = None  # all is measured anew: now it decides by all that counts
                continue
            if count is not None and new >= count.most:
                return ended(conclude(known.settings, goal_of(experiment), count.most))
            if context.should_stop():
                return ended(Stopped())
            partitions = partitions or make_test_partitions(experiment, context, ends)
            began, remaining = times.clock(), times.remaining(experiment, count, new, running=1)
            context.reporter.setting_started(experiment, decision.reserve, remaining)
            setting = run_setting(context, partitions, decision, known)
            if not isinstance(setting, Setting):
                return ended(setting)
            times.add(experiment, times.clock() - began)
            log.add(setting)
            known, new = known.with_run(setting), new + 1
            remaining = times.remaining(experiment, count, new, running=0)
            context.reporter.setting_ended(experiment, known.at(setting.reserve), remaining)
            if (number := other_processors(experiment, setting.used_processors)) is not None:
                return ended(ProcessorNumberChanged(number=number))
