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
from rarms_iac.measuring.strategies import goal_of
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
        ...


@dataclass(frozen=True, slots=True, kw_only=True)
class OtherProcessors:
    """P1 was seen to use another number of processors than it has: what was measured so far is no curve of it."""

    number: int


@dataclass(frozen=True, slots=True, kw_only=True)
class LoopResult:
    """How an experiment ended, and what that rests on."""

    conclusion: Conclusion | OtherProcessors
    settings: tuple[Setting, ...]
    new: int  # how many of them were run now


def measure(
    experiment: Experiment,
    strategy: Strategy,
    log: SettingsLog,
    context: MeasuringContext,
    *,
    most_settings: int | None = None,
) -> LoopResult:
    """Run settings until the strategy has its answer; P1 and P2 are there only meanwhile.

    Args:
        experiment: what is measured.
        strategy: asked for each next setting.
        log: settings in it are not run again; new ones are added as they end.
        context: the host, locked, and who is told.
        most_settings: so many are run at most, as was said beforehand: then what they show is the answer. None: as many
            as the strategy asks for.

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
        anew = log.anew
        decision: ExperimentDecision | OtherProcessors
        while True:
            decision = strategy.decide(known.seen_with(anew))
            if not isinstance(decision, Measure):
                if anew is None:
                    break
                anew = None  # what was asked for is measured anew: all that counts gives the answer
                continue
            if most_settings is not None and new >= most_settings:
                decision = conclude(known.settings, goal_of(experiment))
                break
            if context.should_stop():
                decision = Stopped()
                break
            partitions = partitions or make_test_partitions(experiment, context, ends)
            context.reporter.setting_started(experiment, decision.reserve, len(known.seen_with(anew)) + 1)
            setting = run_setting(experiment, context, partitions, decision, known)
            if not isinstance(setting, Setting):
                decision = setting
                break
            log.add(setting)
            known, new = known.with_run(setting), new + 1
            context.reporter.setting_ended(experiment, known.at(setting.reserve))
            if (number := other_processors(experiment, setting.used_processors)) is not None:
                decision = OtherProcessors(number=number)
                break
    return LoopResult(conclusion=decision, settings=known.settings, new=new)
