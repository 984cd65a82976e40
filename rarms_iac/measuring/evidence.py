"""What a setting shows: every index against its threshold, and whether the setting was what it says. Pure.

P2 is to take all that it reserves; where neither it nor P1 had that time, something else had the processors, and P1 may
have had less than CR. What P1 got of it, because threads that wake up get theirs at once, is the mechanism's own
doing, and in service it is the same. Time that the machine below took makes a component look slower than it is.
"""

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, replace
from fractions import Fraction
from math import inf, isinf

from rarms_iac.measuring.partitions import LoadShare
from rarms_iac.model.capacity import shared_processors
from rarms_iac.model.experiment import Experiment
from rarms_iac.model.host import Host
from rarms_iac.model.indexes import index_named
from rarms_iac.model.loads import Interference, could_take_all, is_steady
from rarms_iac.model.outcomes import Doubt, Estimate, Missed, NoEstimate, Overload, TooManyFailures, Unsteady, Verdict
from rarms_iac.model.output import output
from rarms_iac.model.quantities import ReservePercent
from rarms_iac.model.series import Series
from rarms_iac.model.setting import P1, SHORT, MachineSpeed, Setting, SettingEvidence
from rarms_iac.model.system import AtLeast, AtMost, Component, Threshold, run_of
from rarms_iac.statistics.first_look import point_estimate
from rarms_iac.statistics.overload import estimate_of_setting
from rarms_iac.statistics.steady_state import steady_part
from rarms_iac.statistics.verdicts import judge_look

TRIES = 3
"""So often a disturbed setting is measured at most."""

STOLEN = 0.05
"""The part of all processors' time that the machine below may take: components are slower then, the safe side."""

FREQUENCY_CHANGE = 0.1
"""The part of the frequency by which a setting may end faster or slower than it began. Turbo steps move less."""


def disturbance(evidence: SettingEvidence, processors: int, load: LoadShare | None) -> str:
    """Say what disturbed a setting.

    Args:
        load: the share of the load in P2; None: it does not want all that it can get.

    Returns:
        Words with numbers; empty: nothing did.
    """
    whole = evidence.elapsed_ms * processors
    if not whole:
        return ""
    stolen = evidence.stolen_ms / whole
    if stolen > STOLEN:
        return f"steal time was {100 * stolen:.1f} % of the processor time; at most {100 * STOLEN:.0f} % is allowed"
    if change := _speed_change(evidence.speeds, are_busy=load is not None):
        return change
    if load is None:
        return ""
    p1, p2 = (time / evidence.elapsed_ms for time in (evidence.cpu_ms.get(P1, 0.0), evidence.load_cpu_ms))
    beyond_reserve = max(0.0, p1 - float(load.others))
    if p2 + beyond_reserve < load.processors - SHORT * processors:
        return f"the load in P2 got {p2:.2f} LP of its reserved {float(load.processors):.2f} LP"
    return ""


def _speed_change(speeds: Sequence[MachineSpeed], *, are_busy: bool) -> str:
    """Say what changed between the first and the last moment.

    Args:
        are_busy: Whether all processors had work at both moments: the frequency of idle ones moves by itself.

    Returns:
        Words with numbers; empty: nothing changed, or it is not known.
    """
    if len(speeds) < 2:
        return ""
    first, last = speeds[0], speeds[-1]
    if first.governor != last.governor:
        return f"the frequency governor changed from {first.governor or 'none'} to {last.governor or 'none'}"
    if last.throttled > first.throttled:
        return "heat slowed the processors"
    if first.limit_mhz != last.limit_mhz:
        return f"the highest frequency allowed changed from {first.limit_mhz} to {last.limit_mhz} MHz"
    if are_busy and first.mhz and abs(last.mhz - first.mhz) > FREQUENCY_CHANGE * first.mhz:
        return f"the processors' frequency changed from {first.mhz} to {last.mhz} MHz"
    return ""


def with_memory_kills(failed: TooManyFailures, evidence: SettingEvidence | None) -> TooManyFailures:
    """Add the number of processes of a failed component that the kernel killed for memory."""
    killed = 0 if evidence is None else evidence.out_of_memory.get(failed.component, 0)
    return replace(failed, out_of_memory=killed)


def idle_share(evidence: SettingEvidence, shared: Fraction) -> float:
    """Return the part of the partitions' time that neither P1 nor P2 nor the machine below had.

    Args:
        shared: LPs that all partitions can use together.

    Returns:
        0 to 1; 0 where nothing was counted.
    """
    whole = evidence.elapsed_ms * float(shared)
    used = evidence.cpu_ms.get(P1, 0.0) + evidence.load_cpu_ms + evidence.stolen_ms
    return max(0.0, 1.0 - used / whole) if whole else 0.0


def leaves_idle(evidence: SettingEvidence | None, shared: Fraction) -> bool:
    """Tell whether a load that never sleeps by design left processors idle all the same: more than `SHORT`.

    Args:
        evidence: what the host counted; None: it counts nothing.
        shared: LPs that all partitions can use together.
    """
    return evidence is not None and idle_share(evidence, shared) > SHORT


def is_weak(load: Interference, setting: Setting, host: Host) -> bool:
    """Return whether a load leaves time to P1 that other partitions would take.

    Returns:
        Whether it cannot take all that P2 reserves, or never sleeps by design and was seen to leave some of it idle.
    """
    if not could_take_all(load, host.logical_processors):
        return True
    shared = shared_processors(host, host.logical_processors)
    return is_steady(load) and leaves_idle(setting.evidence, shared)


def with_evidence(
    setting: Setting, evidence: SettingEvidence, disturbances: Sequence[str], *, undisturbed: bool
) -> Setting:
    """Have a setting say what was counted, and what disturbed its tries; where all were disturbed, it has no verdict.

    Args:
        setting: as it was measured in the last try.
        disturbances: of each disturbed try, in order.
        undisturbed: whether the last try was none of them.

    Returns:
        The setting with both.
    """
    proof = replace(evidence, disturbances=tuple(disturbances))
    reason = "" if undisturbed else f"disturbed in each of {len(disturbances)} tries: {disturbances[-1]}"
    series = tuple(replace(each, unsettled=each.unsettled or reason, wanders=True) for each in setting.series)
    return replace(setting, series=series, evidence=proof)


@dataclass(frozen=True, slots=True, kw_only=True)
class MeasuredIndex:
    """One index of a component against its threshold."""

    component: str
    index: str
    threshold: Threshold
    estimate: Estimate | None
    doubt: Doubt | None = None  # why the samples of the first pass hardly show it
    reason: str = ""  # why the estimate is missing
    overload: Overload | None = None  # where the component falls behind, so that the index grows without an end

    @output
    def unit(self) -> str:
        """Of threshold and estimate."""
        return index_named(self.index).symbol

    @property
    def misses(self) -> bool:
        """Whether what was seen is on the wrong side; without an estimate nothing shows that it is not."""
        if self.estimate is None:
            return True
        match self.threshold:
            case AtMost(value=limit):
                return self.estimate.value > float(limit)
            case AtLeast(value=limit):
                return self.estimate.value < float(limit)


def measured_indexes(setting: Setting, experiment: Experiment) -> tuple[MeasuredIndex, ...]:
    """Estimate every index of every member's APT at this setting.

    Returns:
        By member, then in the order of its APT. Those of a setting of the first pass have no bounds.
    """
    seen = {series.component: series for series in setting.series}
    indexes = indexes_of_series(experiment.members, seen)
    return tuple(
        _without_bounds(each, seen[each.component], experiment) if setting.first_pass else each for each in indexes
    )


def _without_bounds(measured: MeasuredIndex, series: Series, experiment: Experiment) -> MeasuredIndex:
    found = point_estimate(measured.index, series, experiment.runs[measured.component])
    if found is None or isinf(found.value):
        return replace(measured, estimate=None)
    count = len(series.samples)
    value = Estimate(value=found.value, lower=-inf, upper=inf, samples=count, effective_samples=float(count))
    return replace(measured, estimate=value, doubt=found.doubt, reason="")


def indexes_of_series(components: tuple[Component, ...], seen: Mapping[str, Series]) -> tuple[MeasuredIndex, ...]:
    """Estimate every index of every component's APT from these series; components without one are left out.

    Returns:
        By component as given, then in the order of its APT.
    """
    return tuple(
        _measured_index(component, index, threshold, seen[component.name])
        for component in components
        if component.name in seen
        for index, threshold in component.apt.items()
    )


def shortfall_at(reserve: ReservePercent, settings: Iterable[Setting], experiment: Experiment) -> Verdict | None:
    """Say why settings at this CR, where not every threshold was met for sure, did not meet them.

    Strict, and with the error of a verdict, as a report judges a setting.

    Returns:
        `Missed` where a threshold was shown to be missed, else `Unsteady` where that kept samples from telling, else
        another verdict; None: there are no such settings.
    """
    verdicts = [
        judge_look(series, member.apt, experiment.runs[member.name], members=len(experiment.members))
        for setting in settings
        if setting.reserve == reserve
        for member in experiment.members
        for series in setting.series
        if series.component == member.name and member.apt
    ]
    most_telling = [verdict for kind in (Missed, Unsteady) for verdict in verdicts if isinstance(verdict, kind)]
    return next(iter([*most_telling, *verdicts]), None)


def why_unsteady(series: Series) -> str:
    """Say why the series has no steady state; empty where it has one.

    Returns:
        The reason in words.
    """
    part = steady_part(series)
    return part.reason if isinstance(part, Unsteady) else ""


def _measured_index(component: Component, index: str, threshold: Threshold, series: Series) -> MeasuredIndex:
    estimate = estimate_of_setting(index, series, run_of(component))
    measured = MeasuredIndex(component=component.name, index=index, threshold=threshold, estimate=None)
    if isinstance(estimate, NoEstimate):
        return replace(measured, reason=estimate.reason, overload=estimate.overload)
    return replace(measured, estimate=estimate)
