"""The verdict on the thresholds of components, by their data logs. Only this module makes it.

In: for each load the data log of components in one partition, or why there is none. Out: a `Decision`.
Plan, page, sheets, status, graph, explanation and studio show it. Begin at `decide`.
"""

from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import partial
from typing import TypeGuard

from rarms_iac.model.claims import WHOLE
from rarms_iac.model.commands import MEASURE, RecommendedCommand, Wording, command, prose
from rarms_iac.model.diagnostics import Diagnostic
from rarms_iac.model.experiment import ProcessorSource
from rarms_iac.model.outcomes import Achievement, ReservationVerdict, ThresholdAchievement, UncertainEstimate, worst
from rarms_iac.model.quantities import ReservePercent, guaranteed
from rarms_iac.model.system import Component, Threshold
from rarms_iac.planner import planning_findings
from rarms_iac.statistics.curves import Curve, highest_missed, least_reserve
from rarms_iac.storage.datalog.log import DataLog, Recorded
from rarms_iac.texts.findings import Finding, Given
from rarms_iac.texts.messages import counted
from rarms_iac.texts.quantities import show_processors

Names = tuple[str, ...]
"""Components together in one partition, in the order of their names."""


@dataclass(frozen=True, slots=True, kw_only=True)
class NotMeasured:
    """These components have no answer, and why."""

    interference: str = ""  # the load whose data log is missing or does not hold; empty: no load to name
    why: Diagnostic  # without a place


def not_measured(
    finding: Finding,
    components: Names,
    platform: str,
    template: str,
    advice: Wording,
    *,
    load: str = "",
    **facts: Given,
) -> NotMeasured:
    """Return the reason for an unknown reservation on a platform, at the first of the components.

    A partition whose reserve is fixed has no such component.
    """
    address = f"component/{components[0]}" if components else ""
    about: Mapping[str, Given] = {"components": components, "platform": platform, **facts}
    return NotMeasured(interference=load, why=finding.at(None, template, advice, address=address, related=(), **about))


def without_log(components: Names, platform: str) -> NotMeasured:
    """Report that no data log has the reservation of these components."""
    template = "The reservation of {components:each} is not measured on platform {platform}."
    advice = "Measure it first, or set a fixed reserve: `cpu: { reserve: ... }`."
    return not_measured(planning_findings.UNMEASURED, components, platform, template, advice)


@dataclass(frozen=True, slots=True, kw_only=True)
class MeasuredTogether:
    """The data log of components in one partition with one load, for the hosts that it holds for."""

    path: str  # as messages name it
    interference: str  # the load
    processors: int  # of P1: a CR is per cent of these
    measured: tuple[int, ...]  # the CRs that were measured, ascending
    least: int | None = None  # the least CR that is enough with every load, as `decide` found it; None: none is
    curves: Callable[[str, str], Curve]  # by component and index
    estimated: ReservePercent | None = None  # the least CR that is enough by estimates; None: no first pass, or none is
    uncertain_at: Callable[[ReservePercent], tuple[UncertainEstimate, ...]] = lambda _reserve: ()
    looks: int = 0  # settings of the first pass
    records: DataLog  # that the curves are of
    used_records: tuple[Recorded, ...] = ()  # that its answer is of; of the first pass, too, where none is shown
    others: int = 0  # settings in the same file that were measured under other conditions, and do not count
    remarks: tuple[Diagnostic, ...] = ()  # as of `LookedUp`
    again: RecommendedCommand = MEASURE  # what measures it
    weak: bool = False  # its load cannot take all that P2 reserves, or left some of it idle
    cpu_ms: Callable[[str], float | None] = lambda _component: None  # processor time of a component's job, on average
    processors_from: ProcessorSource = ProcessorSource.HOST
    used: int | None = None  # the most processors that they were seen to use at once; None: that was not seen

    def measured_below(self, reserve: int) -> int:
        """Return the next lower CR that was measured; 0: none was.

        Args:
            reserve: the CR in per cent of P1's own processors.
        """
        return max((each for each in self.measured if each < reserve), default=0)


LogOfLoad = MeasuredTogether | NotMeasured
"""What is known with one load."""


Apt = tuple[str, str, Threshold]
"""Component, performance index and threshold."""

_Answers = Sequence[tuple[MeasuredTogether, ReservePercent | None]]
"""Each data log with the least CR that it shows to be enough; None: it shows none."""


def with_curves(
    members: Iterable[Component], curves: Callable[[str, str], Curve]
) -> tuple[tuple[Curve, Threshold], ...]:
    """Return each threshold of the components with the curve of its index.

    Args:
        curves: by component and index.
    """
    return tuple(
        (curves(member.name, index), threshold) for member in members for index, threshold in member.apt.items()
    )


@dataclass(frozen=True, slots=True, kw_only=True)
class Decision:
    """The verdict, and the data log that decides it."""

    verdict: ReservationVerdict
    log: MeasuredTogether | None = None  # of the load that needs the largest reservation; None: nothing is measured


def decide(members: Sequence[Component], logs: Sequence[LogOfLoad]) -> Decision:
    """Judge the thresholds of components by their data logs, one for each load.

    A threshold is met if a measured reservation is enough with each load. It is missed if it is missed with one load at
    the highest reservation that was measured with that load. All other thresholds are open. If no measured reservation
    meets all thresholds at once, thresholds that are met one by one are open. Where not all are met and
    none is missed, the estimates of the first pass give a provisional answer.

    Args:
        logs: the data log of each load, or the reason why it does not count, in the order of the loads.

    Returns:
        The verdict. If several loads need the same reservation, the log with the highest setting below it decides.
    """
    apts = [(member.name, index, threshold) for member in members for index, threshold in member.apt.items()]
    known = [log for log in logs if isinstance(log, MeasuredTogether)]
    missing = tuple(log.interference for log in logs if isinstance(log, NotMeasured) or not log.measured)
    if any(_is_unusable(log) for log in logs):
        return Decision(verdict=_verdict([(apt, Achievement.UNMEASURED) for apt in apts], missing))
    answers = [(log, least_reserve(with_curves(members, log.curves))) for log in known]
    decision = _decide_measured(apts, [each for each in answers if each[0].measured], missing)
    return decision if decision.verdict.achievement is Achievement.MET else _provisional(apts, answers, decision)


def _decide_measured(apts: Sequence[Apt], answers: _Answers, missing: Names) -> Decision:
    if not answers:
        return Decision(verdict=_verdict([(apt, Achievement.UNMEASURED) for apt in apts], missing))
    known = [log for log, _ in answers]
    _, least = answers[hardest([answer for _, answer in answers])]
    asking_for_most = [log for log, answer in answers if answer == least]
    decisive = max(asking_for_most, key=partial(_weight, apts=apts, least=least))
    achievements = [(apt, worst(tuple(_achievement(apt, log) for log in known))) for apt in apts]
    if least is None and all(achievement is Achievement.MET for _, achievement in achievements):
        achievements = [(apt, Achievement.OPEN) for apt in apts]
    elif missing:
        achievements = [
            (apt, Achievement.UNMEASURED if achievement is Achievement.MET else achievement)
            for apt, achievement in achievements
        ]
    verdict = _verdict(achievements, missing, decisive.interference, least)
    return Decision(verdict=verdict, log=replace(decisive, least=verdict.reserve))


def _provisional(apts: Sequence[Apt], shown: _Answers, decision: Decision) -> Decision:
    """Decide by the estimates of the first pass where verdicts do not decide; as before where there are none.

    A load with verdicts that show a reservation counts with this one. A threshold that was shown to be missed stays so.
    """
    if any(each.achievement is Achievement.MISSED for each in decision.verdict.thresholds):
        return decision
    answers = [(log, log.estimated if least is None else least) for log, least in shown]
    found = [(log, answer) for log, answer in answers if answer is not None]
    unmet = [log for log, answer in answers if answer is None]
    if not any(log.estimated is not None for log, _ in shown) or any(log.measured or log.looks for log in unmet):
        return decision
    # Of loads that need the same, the one with which the first pass searched decides, as in the table of `measure`.
    decisive, least = max(found, key=lambda each: (each[1], each[0].looks))
    achievements = [(apt, Achievement.PROVISIONAL) for apt in apts]
    verdict = _verdict(achievements, decision.verdict.not_measured, decisive.interference, least)
    return Decision(verdict=verdict, log=replace(decisive, least=least))


def _is_unusable(log: LogOfLoad) -> TypeGuard[NotMeasured]:
    """Return whether a data log is stale or damaged: it has no verdict without a new measurement."""
    return isinstance(log, NotMeasured) and log.why.code != planning_findings.UNMEASURED.code


def _verdict(
    achievements: Iterable[tuple[Apt, Achievement]], missing: Names, interference: str = "", so_far: int | None = None
) -> ReservationVerdict:
    thresholds = (
        ThresholdAchievement(component=component, index=index, threshold=threshold, achievement=achievement)
        for (component, index, threshold), achievement in achievements
    )
    return ReservationVerdict(
        thresholds=tuple(thresholds), interference=interference, so_far=so_far, not_measured=missing
    )


def _weight(log: MeasuredTogether, *, apts: Sequence[Apt], least: int | None) -> int:
    """Return a larger number for a log that shows better why a smaller reservation, or each one, is not enough.

    NOTE: a load may be measured only at the reservation that another load needs. That log has no smaller setting.
    """
    if least is not None:
        return log.measured_below(least)
    return list(Achievement).index(worst(tuple(_achievement(apt, log) for apt in apts)))


def _achievement(apt: Apt, log: MeasuredTogether) -> Achievement:
    component, index, threshold = apt
    curve = log.curves(component, index)
    if least_reserve([(curve, threshold)]) is not None:
        return Achievement.MET
    return Achievement.MISSED if highest_missed([(curve, threshold)]) >= max(log.measured) else Achievement.OPEN


def hardest(reserves: Sequence[int | None]) -> int:
    """Find the load that needs the largest reservation: only this one is enough with each load.

    Args:
        reserves: the least reservation with each load, in whole per cent; None: no measured one is enough.

    Returns:
        The position of that load; of several, the first. None counts as the largest.
    """
    amounts = [WHOLE + 1 if reserve is None else reserve for reserve in reserves]
    return amounts.index(max(amounts))


def why_unknown(names: Names, decision: Decision, logs: Sequence[LogOfLoad], platform: str) -> NotMeasured:
    """Explain a verdict without a reservation, and recommend a command.

    Args:
        names: the components of the partition that have to be measured.
        decision: its verdict is not `MET`.

    Returns:
        The reason with the log's path, and advice.
    """
    unmeasured = [log for log in logs if isinstance(log, NotMeasured)]
    if unusable := [log for log in logs if _is_unusable(log)]:
        return unusable[0]
    log = decision.log
    if log is None or not decision.verdict.thresholds:
        empty = [log for log in logs if isinstance(log, MeasuredTogether)]
        empty.sort(key=lambda log: not log.looks or log.estimated is not None)  # first what missed in the first pass
        return _no_setting(names, empty[0]) if empty else next(iter(unmeasured), without_log(names, platform))
    if decision.verdict.achievement is Achievement.UNMEASURED:
        return _more_loads(names, decision.verdict, log)
    return _not_met(names, decision.verdict, log, [log for log in logs if isinstance(log, MeasuredTogether)])


def _no_setting(names: Names, log: MeasuredTogether) -> NotMeasured:
    template = "{log}: no setting of the first pass meets the thresholds."
    if not log.looks:
        template = "{log} does not have a setting with {_processors} yet."
    return not_measured(
        planning_findings.NOT_MET,
        names,
        log.records.header.platform,
        template,
        prose("Measure first: ", log.again, "."),
        log=log.path,
        highest_percent=0,
        indexes=(),
        _processors=counted(log.processors, "virtual processor"),
    )


def _more_loads(names: Names, verdict: ReservationVerdict, log: MeasuredTogether) -> NotMeasured:
    """Explain that the reservation is known with some loads, and that the others are not measured."""
    assert verdict.so_far is not None, "else a threshold is open or missed"
    so_far = guaranteed(verdict.so_far, log.processors)
    return not_measured(
        planning_findings.UNMEASURED,
        names,
        log.records.header.platform,
        (
            "{components:all} needs {_so_far} with {_load} and is not measured with "
            "{loads_not_measured:all} yet. A reservation must be enough with each load of "
            "`policy.interference`."
        ),
        prose(
            "Measure the other loads: ",
            log.again,
            f". Or set at least this fixed reserve: `cpu: {{ reserve: {show_processors(so_far)} }}`.",
        ),
        log=log.path,
        needs_lp_so_far=float(so_far),
        loads_not_measured=verdict.not_measured,
        _so_far=show_processors(so_far),
        _load=verdict.interference,
    )


def _not_met(
    names: Names, verdict: ReservationVerdict, log: MeasuredTogether, measured: Sequence[MeasuredTogether]
) -> NotMeasured:
    """Explain that no setting meets every threshold, with the names of the worst ones."""
    highest = max(log.measured)
    named = [(each.component, each.index) for each in verdict.thresholds if each.achievement is verdict.achievement]
    component, index = named[0]
    several = sum(each.component == component for each in verdict.thresholds) > 1
    select = command("select", component, at="LEVEL", index=several and index)
    relax = prose("Relax the threshold (", select, " shows the levels that can be met), ")
    if verdict.achievement is Achievement.OPEN:
        template = (
            "{log}: at {highest_percent:%} of its VPs the samples do not show whether {_indexes} meets its threshold."
        )
        advice = prose(
            "More samples may give a verdict. ",
            log.again,
            " shows the number of samples and the time for `policy.measuring.setting`.",
        )
    elif highest < WHOLE:
        template = "No setting of {log} meets {_indexes}. The highest setting is {_settings}."
        advice = prose(relax, "or measure higher settings, if the host can give them: ", log.again, ".")
    else:
        template = "No setting of {log} meets {_indexes}, even at 100 % of its VPs."
        advice = prose(relax, "make the component faster, or use a faster platform.")
    return not_measured(
        planning_findings.NOT_MET,
        names,
        log.records.header.platform,
        template,
        advice,
        log=log.path,
        highest_percent=highest,
        indexes=tuple(f"{component}/{index}" for component, index in named),
        _indexes=" and ".join(f"{index} of {component}" for component, index in named),
        _settings=_highest_settings(log, measured),
    )


def _highest_settings(log: MeasuredTogether, measured: Sequence[MeasuredTogether]) -> str:
    """Describe the highest CR of a log, and those with other loads if they differ."""
    highest = {each.interference: max(each.measured, default=0) for each in (log, *measured)}
    own = highest.pop(log.interference)
    others = [f"{reserve} % with {load}" for load, reserve in highest.items() if reserve != own]
    share = f"{own} % of its VPs"
    return f"{share} with {log.interference}, and {', '.join(others)}" if others else share
