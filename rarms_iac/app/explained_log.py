"""The rows of an explanation that come from thresholds and the data log."""

from collections.abc import Iterator, Sequence, Set
from dataclasses import dataclass

from rarms_iac.model.indexes import index_named
from rarms_iac.model.system import AtMost, Component, Threshold
from rarms_iac.planner.groups import Group
from rarms_iac.planner.verdicts import MeasuredTogether, with_curves
from rarms_iac.statistics.curves import Curve, highest_missed, holds
from rarms_iac.statistics.distributions import describe_extreme
from rarms_iac.texts.indexes import show_threshold, show_value
from rarms_iac.texts.messages import counted, in_a_row
from rarms_iac.texts.quantities import share_of_processors, show_processors


@dataclass(frozen=True, slots=True)
class ExplainedValue:
    """A value on the way to what a component gets."""

    name: str
    value: str
    source: str = ""  # where it comes from, or why it is so


def threshold_rows(component: Component, of: str) -> Iterator[ExplainedValue]:
    """Yield the thresholds of a component; `of` says whose they are, where that is not clear."""
    for index, threshold in component.apt.items():
        value = show_threshold(index_named(index), threshold)
        yield ExplainedValue(f"{index}{of}", value, "manifest")
    if not component.apt and not of:
        yield ExplainedValue("threshold", "none", "manifest")


def log_rows(
    component: Component, group: Group, loads: Sequence[str], log: MeasuredTogether, *, is_used: bool
) -> Iterator[ExplainedValue]:
    """Yield the data log, and its indexes at the least reserve (or the highest measured) and at one lower.

    A log that is not used, as the manifest fixes the reserve, has no indexes here.
    """
    yield from _origin_rows(loads, log, is_used=is_used)
    if not is_used:
        return
    least = log.least
    at = least if least is not None else max(log.measured, default=0)
    yield from _index_rows(component, group, log, at)
    curves = [log.curves(member.name, index) for member in group.members for index in member.apt]
    unclear = sorted({reserve for curve in curves for reserve in curve.inconclusive})
    if least is not None and least > 1:
        yield from _index_rows(component, group, log, least - 1)
        if not _falls_short(group, log, least - 1):
            overloaded = {reserve for curve in curves for reserve in curve.overloaded}
            yield ExplainedValue(_at(log, least - 1), _why_unknown(least - 1, overloaded, unclear), "data log")
    if unclear:
        values = ", ".join(f"{reserve} % of its VPs" for reserve in unclear)
        yield ExplainedValue("no verdict at", values, "no steady state, or too few answers")
    for remark in log.remarks:
        yield ExplainedValue("remark", remark.detail, "data log")


def _falls_short(group: Group, log: MeasuredTogether, reserve: int) -> bool:
    """Return whether a curve has a value at the reserve that is not shown to meet its threshold."""
    pairs = with_curves(group.members, log.curves)
    return any(curve.value_at(reserve) is not None and not holds(curve, apt, reserve) for curve, apt in pairs)


def _index_rows(component: Component, group: Group, log: MeasuredTogether, reserve: int) -> Iterator[ExplainedValue]:
    """Yield the values of the curves there, without curves that end elsewhere."""
    for member in group.members:
        of = "" if member is component else f" of {member.name}"
        for index, threshold in member.apt.items():
            curve = log.curves(member.name, index)
            point = curve.value_at(reserve)
            if point is not None:
                estimate = curve.estimate_at(reserve)
                yield ExplainedValue(
                    f"{index}{of} at {_at(log, reserve)}",
                    _judged(index, threshold, curve, reserve),
                    "between two measured settings" if estimate is None else counted(estimate.samples, "sample"),
                )


def _origin_rows(loads: Sequence[str], log: MeasuredTogether, *, is_used: bool) -> Iterator[ExplainedValue]:
    times = sorted(recorded.provenance.when for recorded in log.records.recorded)
    parts = [
        counted(len(log.measured), "setting"),
        *([" to ".join(dict.fromkeys((times[0], times[-1])))] if times else []),
    ]
    parts += [f"{counted(log.looks, 'setting')} of the first pass"] if log.looks else []
    parts += [f"{log.others} more from other conditions"] if log.others else []
    parts += [] if is_used else ["not used"]
    yield ExplainedValue("data log", log.path, ", ".join(parts))
    platform = log.records.header.platform_facts
    smt = "with SMT" if platform.smt else "without SMT"
    build = f", build {platform.os_build}" if platform.os_build else ""
    yield ExplainedValue(
        "measured on",
        f"{platform.provider.value}, {show_processors(platform.logical_processors)} {smt}",
        f"{platform.processor or 'no processor model'}, scheduler {platform.scheduler.value}{build}",
    )
    others = [load for load in loads if load != log.interference]
    source = f"needs the most; {in_a_row(others)} need no more" if others else ""
    yield ExplainedValue("load", log.interference, source)


def _at(log: MeasuredTogether, reserve: int) -> str:
    return share_of_processors(reserve, log.processors)


def _judged(index: str, threshold: Threshold, curve: Curve, reserve: int) -> str:
    """Write a verdict as `97 ms, at worst 98.3 ms: met`, by `holds` and the curve's band as for a reservation."""

    def shown(value: float) -> str:
        return show_value(index_named(index), value, threshold)

    point, estimate = curve.value_at(reserve), curve.estimate_at(reserve)
    assert point is not None, "the caller has the curve"
    seen = (estimate or point).value
    met = holds(curve, threshold, reserve)
    if index_named(index).is_extreme:
        beyond = "so far" if estimate is None or estimate.beyond is None else describe_extreme(estimate.beyond)
        return f"{shown(seen)} {beyond}: {'met so far' if met else 'missed'}"
    worst = point.upper if isinstance(threshold, AtMost) else point.lower
    missed = reserve <= highest_missed([(curve, threshold)])
    return f"{shown(seen)}, at worst {shown(worst)}: {'met' if met else 'missed' if missed else 'not shown to be met'}"


def _why_unknown(reserve: int, overloaded: Set[int], unclear: Sequence[int]) -> str:
    if reserve in overloaded:
        return "missed: jobs arrive faster than they are completed"
    if reserve in unclear:
        return "measured, without a verdict"
    return "not measured; lower settings gave no verdict" if any(at < reserve for at in unclear) else "not measured"
