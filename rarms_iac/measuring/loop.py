"""The loop of measuring: a strategy asks for a setting, it is run (`setting_run`), and the log records it.

A strategy is a pure function of the recorded settings. So a run that was killed goes on by asking it again, and a
setting that is recorded is never run a second time.
"""

from collections.abc import Sequence
from contextlib import ExitStack
from dataclasses import dataclass
from typing import Protocol

from rarms_iac.measuring.search.trials import conclude
from rarms_iac.measuring.setting_run import (
    MeasuringContext,
    TestPartitions,
    make_test_partitions,
    other_processors,
    run_setting,
)
from rarms_iac.measuring.settings_log import KnownSettings, SettingsLog
from rarms_iac.measuring.setup import Experiment
from rarms_iac.measuring.strategies import SettingCount, goal_of
from rarms_iac.measuring.wall_times import RemainingSettings
from rarms_iac.model.outcomes import Conclusion, ExperimentDecision, Measure, Stopped
from rarms_iac.model.setting import Setting


class Strategy(Protocol):
    """Which setting is next; the same settings give the same answer."""

    def decide(self, settings: Sequence[Setting]) -> ExperimentDecision:
        """Say what to do after these settings, in the order in which they were run.

        Args:
            settings: those that count for this run.

        Returns:
            The next setting, or how the experiment ends.
        """


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


def measure(
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
        log: settings in it are not run again; new ones are added as they end.
        context: the host, locked, and who is told.
        count: so many settings are run at least and at most, as was said beforehand: what the last one shows is the
            answer. None: as many as the strategy asks for.

    Returns:
        How it ended, with all settings that count.

    Raises:
        HostError: the host did not do what was asked; what is recorded stays.
        OSError: the log cannot be written.
    """
    known, new = KnownSettings(runs=log.runs(), simulated=log.is_simulated), 0
    context.reporter.experiment_started(experiment, known.settings)
    with ExitStack() as ends:
        ends.callback(context.reporter.experiment_ended)
        partitions: TestPartitions | None = None
        remeasure_seed = log.remeasure_seed
        decision: ExperimentDecision | ProcessorNumberChanged
        while True:
            decision = strategy.decide(known.seen_with(remeasure_seed))
            if not isinstance(decision, Measure):
                if remeasure_seed is None:
                    break
                remeasure_seed = None  # what was asked for is measured anew: all that counts gives the answer
                continue
            if count is not None and new >= count.most:
                decision = conclude(known.settings, goal_of(experiment), count.most)
                break
            if context.should_stop():
                decision = Stopped()
                break
            partitions = partitions or make_test_partitions(experiment, context, ends)
            began, remaining = context.wall_times.clock(), _remaining(experiment, context, count, new, running=1)
            context.reporter.setting_started(experiment, decision.reserve, remaining)
            setting = run_setting(experiment, context, partitions, decision, known)
            if not isinstance(setting, Setting):
                decision = setting
                break
            context.wall_times.add(experiment, context.wall_times.clock() - began)
            log.add(setting)
            known, new = known.with_run(setting), new + 1
            remaining = _remaining(experiment, context, count, new, running=0)
            context.reporter.setting_ended(experiment, known.at(setting.reserve), remaining)
            if (number := other_processors(experiment, setting.used_processors)) is not None:
                decision = ProcessorNumberChanged(number=number)
                break
    return LoopResult(conclusion=decision, settings=known.settings, new=new)


def _remaining(
    experiment: Experiment, context: MeasuringContext, count: SettingCount | None, new: int, *, running: int
) -> RemainingSettings | None:
    """What is left after so many new settings, one that runs included."""
    if count is None:
        return None
    return context.wall_times.remaining(experiment, max(running, count.least - new), count.most - new)
