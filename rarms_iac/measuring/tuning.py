"""Tuning: the oracle that measures what is asked for, and the search that asks.

`search_combinations` has a strategy ask for settings until it has an answer, or is stopped.
"""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, field, replace

from rarms_iac.app.control import WorkBegun
from rarms_iac.app.graph import recorded_answers
from rarms_iac.measuring.duration import Announced, least_ms
from rarms_iac.measuring.each_load import after_loads
from rarms_iac.measuring.findings import why_out_of_memory
from rarms_iac.measuring.measure_request import ExperimentResult, settings_of
from rarms_iac.measuring.other_work import work_of_settings
from rarms_iac.measuring.passes import begin_with_hardest
from rarms_iac.measuring.run_experiment import run_experiment
from rarms_iac.measuring.session import MeasuringSession
from rarms_iac.measuring.strategies import ThresholdCheck
from rarms_iac.measuring.tuning_subject import LayoutFit, TuningSubject
from rarms_iac.measuring.units import unit_of_question
from rarms_iac.model.diagnostics import Diagnostic, Places
from rarms_iac.model.experiment import Experiment
from rarms_iac.model.host import ProviderKind
from rarms_iac.model.outcomes import SettingFailed, Stopped, TooManyFailures
from rarms_iac.model.quantities import ReservePercent
from rarms_iac.planner.combining.candidates import Contradiction, informed
from rarms_iac.planner.combining.oracle import Coi, Members, PlannerReporter, Unanswered, processors_of, total
from rarms_iac.planner.combining.paper import MOST_OF_PAIR, Inquiry, ordered, tune_performance_to_use_less_resource
from rarms_iac.planner.combining.questions import Best, most_questions, search, tuning_of
from rarms_iac.statistics.curves import components_not_shown, curves_of, highest_missed
from rarms_iac.storage.datalog.decisions import TrailSetting, TuningEnding, TuningStrategy, UnprovedNeed
from rarms_iac.texts.messages import counted
from rarms_iac.texts.quantities import show_duration


class TuningStopped(Unanswered):
    """A user asked for an end; what is recorded stays, and the same command goes on."""


class LacksMemory(Unanswered):
    """The kernel killed processes of a compound, whose partition had no memory left."""


@dataclass(slots=True, kw_only=True)
class Experiments:
    """A `PerformanceOracle` that runs what the data logs do not know yet."""

    subject: TuningSubject
    session: MeasuringSession  # it holds the host that compounds are measured on
    strategy: TuningStrategy = "default"  # by which it is asked
    samples: int | None = None  # of each component; None: as its `run.until` says
    most_pairs: int = 0  # that the paper's procedure may try
    _units: int = 0  # settings, each with one load, that ended
    _answers: list[TrailSetting] = field(default_factory=list)
    _known: dict[tuple[Members, int], frozenset[str]] = field(default_factory=dict)
    _unresolved: set[tuple[Members, int]] = field(default_factory=set)
    _measured_with: dict[tuple[Members, str], ExperimentResult] = field(default_factory=dict)  # members and load

    def work_findings(self, places: Places) -> Iterator[Diagnostic]:
        """Find compounds whose work ran outside of their partition, or that lacked memory."""
        for members in sorted({members for members, _ in self._measured_with}):
            results = [result for (names, _), result in self._measured_with.items() if names == members]
            yield from work_of_settings(results[0].experiment, *settings_of(results), places)

    def worse(self, members: Members, reserve: ReservePercent) -> frozenset[str]:
        """Run this setting, unless its answer is known.

        Returns:
            Those that were not shown to meet all their thresholds; none: it is enough.

        Raises:
            Unanswered: Too many samples failed.
            TuningStopped: an end was asked for.
            UseCaseError: The host is busy (refused), or there is nothing to run (negative).
            HostError: The host did not do what was asked.
        """
        if (members, reserve) not in self._known:
            self._known[members, reserve] = self._measured(members, reserve)
        return self._known[members, reserve]

    def unresolved(self, members: Members, reserve: ReservePercent) -> bool:
        """Tell whether none of those that are worse there was shown to miss a threshold.

        Args:
            members: sorted names, of which `worse` was asked.

        Returns:
            Whether its samples could not tell.
        """
        return (members, reserve) in self._unresolved

    def _measured(self, members: Members, reserve: ReservePercent) -> frozenset[str]:
        if reserve > (highest := self.subject.highest(members)):
            names = ", ".join(members)
            raise Unanswered(
                f"A measurement of {names} needs {reserve} % of their VPs, but the host can give only {highest} %."
            )
        experiments = begin_with_hardest(self.subject.experiments(members, self.strategy, self.samples))
        if not self._measured_with:
            self._begin(experiments)
        results: list[ExperimentResult] = []
        worse: frozenset[str] = frozenset()
        for number, each in enumerate(experiments, 1):
            result, worse = self._worse_with_load(after_loads(results, each), members, reserve)
            results.append(result)
            is_last = bool(worse) or number == len(experiments)
            if is_last:
                self._answers.append(TrailSetting(components=members, reserve=reserve, worse=tuple(sorted(worse))))
            left = self._most_left() * len(experiments) - (0 if is_last else number)
            self._units += 1
            unit = unit_of_question(
                result,
                reserve,
                worse,
                unresolved=(members, reserve) in self._unresolved,
                number=self._units,
                of=self._units + left,
            )
            self.session.control.reporter.settings.unit_ended(unit)
            if is_last:
                break
        return worse

    def _begin(self, experiments: Sequence[Experiment]) -> None:
        """Report how much work there is at most.

        Args:
            experiments: of the first combination, one a load.
        """
        settings, reporter = self._most_left(), self.session.control.reporter
        window_ms = self.session.host_of(experiments[0]).scheduler_memory_ms
        least = sum(least_ms(each, each.load, window_ms) for each in experiments)
        longest = settings * max(least, experiments[0].budget.most_ms)
        reporter.message(_describe_work(self.subject, self.strategy, experiments, settings, longest))
        announced = Announced(work="Tuning", most_ms=longest, say=reporter.message)
        self.session = replace(self.session, announced=announced)
        reporter.settings.work_begun(WorkBegun(units=settings * len(experiments), at_most=True))

    def _most_left(self) -> int:
        """Return the number of settings that may yet be asked for, each with all loads."""
        if self.strategy == "paper":
            return self.most_pairs * MOST_OF_PAIR - len(self._answers)
        return most_questions(informed(self.subject.candidates(), self._answers))

    def _worse_with_load(
        self, experiment: Experiment, members: Members, reserve: ReservePercent
    ) -> tuple[ExperimentResult, frozenset[str]]:
        """Return the result and the members that miss a threshold: to pass all loads is to pass each."""
        result = run_experiment(self.session, experiment, ThresholdCheck(reserve=reserve, strategy=self.strategy))
        self._measured_with[members, result.interference] = result
        match result.conclusion:
            case Stopped():
                raise TuningStopped("stopped")
            case SettingFailed(verdict=TooManyFailures(component=component, failures=failures) as failed):
                others = ", ".join(member for member in members if member != component)
                raise (LacksMemory if failed.out_of_memory else Unanswered)(
                    f"{counted(len(failures), 'sample')} of {component} failed, together with {others} "
                    f"at {reserve} % of its VPs: {failures[0]}.{why_out_of_memory(failed.out_of_memory)}"
                )
            case _:
                pass
        curves = curves_of(result.settings, experiment.runs, experiment.apts)
        worse = frozenset(components_not_shown(curves, reserve))
        # What was shown to be missed at a higher CR is shown here, too.
        if worse and reserve > highest_missed(curves):
            self._unresolved.add((members, reserve))
        return result, worse


def _describe_work(
    subject: TuningSubject,
    strategy: TuningStrategy,
    experiments: Sequence[Experiment],
    settings: int,
    longest_ms: float,
) -> str:
    """Return the sentence with which tuning begins: the most that there is to do, as each answer decides what follows.

    Args:
        experiments: of the first combination, one a load.
        settings: that may be asked for, each with all loads.
        longest_ms: that all of them may take, by the host's clock.
    """
    host = subject.host
    simulated, clock = "", ""
    if host.provider is ProviderKind.SIMULATED:
        simulated, clock = " (simulated)", " of host time"
    loads = f" x {counted(len(experiments), 'load')}" if len(experiments) > 1 else ""
    most = counted(settings, "setting")
    if strategy != "paper":
        most = f"{counted(len(subject.candidates().by_mask), 'combination')}, {most}"
    partitions = counted(len(subject.cois), "partition")
    longest = f"about {show_duration(longest_ms)}{clock}"
    return f"Tuning {partitions}{loads} on {host.name}{simulated}: at most {most}, {longest}."


@dataclass(frozen=True, slots=True, kw_only=True)
class TuningConclusion:
    """The end of the search, and the CoIs that it leaves."""

    subject: TuningSubject
    ending: TuningEnding
    cois: tuple[Coi, ...]  # most critical first
    trail: tuple[TrailSetting, ...] = ()
    proved: bool = False
    contradictions: tuple[Contradiction, ...] = ()
    doubts: tuple[UnprovedNeed, ...] = ()
    unanswered: str = ""  # why a compound could not be measured
    lacks_memory: bool = False  # that is the reason
    findings: tuple[Diagnostic, ...] = ()  # of its settings, and of `starting_again`

    @property
    def before(self) -> int:
        """What all partitions reserved before, in per cent of one logical processor."""
        return total(self.subject.cois) + self.subject.fixed

    @property
    def after(self) -> int:
        """What all partitions reserve as the search leaves them, in per cent of one logical processor."""
        return total(self.cois) + self.subject.fixed

    @property
    def compounds(self) -> tuple[Coi, ...]:
        """The compounds that tuning made."""
        return tuple(coi for coi in self.cois if coi not in self.subject.cois)

    def parts_of(self, coi: Coi) -> Sequence[Coi]:
        """Return the CoIs that were tuned and are in this compound; a CoI as it was is its own part.

        Returns:
            In the order of the subject.
        """
        return [part for part in self.subject.cois if set(part.members) <= set(coi.members)]


def search_combinations(
    subject: TuningSubject, inquiry: Inquiry, strategy: TuningStrategy, *, repeat: bool
) -> TuningConclusion:
    """Ask for settings by this strategy, until there is an answer or an end is asked for.

    Args:
        inquiry: Who answers, who hears of the answers, and who may decline a combination.
        strategy: `paper`, or else the candidate graph.
        repeat: Whether the paper's procedure goes on after its first combination.

    Returns:
        How it ended. That the oracle has no answer (`Unanswered`) is an ending, too.

    Raises:
        UseCaseError: A data log cannot be read; or, of an oracle that measures, a setting could not be run.
        HostError: Of such an oracle: the host did not do what was asked.
    """
    trail: list[TrailSetting] = []
    recorded = replace(inquiry, reporter=_TrailReporter(inquiry.reporter, subject, trail))
    start = TuningConclusion(subject=subject, ending="stopped", cois=ordered(subject.cois))
    try:
        end = _by_the_paper(start, recorded, repeat=repeat) if strategy == "paper" else _by_the_graph(start, recorded)
    except TuningStopped:  # before Unanswered, of which it is a kind
        end = start
    except Unanswered as problem:
        lacks_memory = isinstance(problem, LacksMemory)
        end = replace(start, ending="unable", unanswered=str(problem), lacks_memory=lacks_memory)
    return replace(end, trail=tuple(trail))


class _TrailReporter:
    """A reporter that collects the answers, also when an end is asked for, and passes all on to another."""

    def __init__(self, reporter: PlannerReporter, subject: TuningSubject, trail: list[TrailSetting]) -> None:
        self._reporter = reporter
        self._subject = subject
        self._trail = trail

    def setting_answered(self, answer: TrailSetting) -> None:
        """Collect it, and pass it on with the virtual processors that it is per cent of."""
        parts = [coi for coi in self._subject.cois if set(coi.members) <= set(answer.components)]
        self._trail.append(replace(answer, processors=processors_of(parts)))
        self._reporter.setting_answered(self._trail[-1])

    def declined(self, members: Members) -> None:
        """Pass the message on."""
        self._reporter.declined(members)

    def combined(self, compound: Coi, before: int) -> None:
        """Pass the message on."""
        self._reporter.combined(compound, before)


def _by_the_paper(start: TuningConclusion, inquiry: Inquiry, *, repeat: bool) -> TuningConclusion:
    subject = start.subject
    layout_fit = LayoutFit(subject=subject)
    done = tune_performance_to_use_less_resource(subject.cois, layout_fit.fits, inquiry, repeat=repeat)
    ending: TuningEnding = "nothing_to_do"
    if done.needed:
        ending = "successful" if done.compounds else "unable"
    return replace(start, ending=ending, cois=done.cois)


def _by_the_graph(start: TuningConclusion, inquiry: Inquiry) -> TuningConclusion:
    subject = start.subject
    layout_fit = LayoutFit(subject=subject)
    tuning = replace(
        tuning_of(subject.cois, subject.objective(layout_fit), inquiry.may_share, most=subject.most),
        predict=subject.predict,
    )
    recorded = recorded_answers(
        subject.hosts.manifest, subject.host, tuning.candidates, {subject.host.name: subject.state}
    )
    best, _ = search(tuning, inquiry, recorded=recorded)
    proved = best.proved and not layout_fit.unsure
    if not isinstance(best, Best):
        return replace(start, ending="unable", proved=proved, contradictions=best.contradictions, doubts=best.doubts)
    end = replace(start, cois=best.cois, proved=proved, contradictions=best.contradictions, doubts=best.doubts)
    for compound in end.compounds:
        inquiry.reporter.combined(compound, total(end.parts_of(compound)))
    return replace(end, ending="successful" if end.compounds else "nothing_to_do")
