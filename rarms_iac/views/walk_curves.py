"""What `rarms explain COMPONENT` says of curves: verdicts at the reservation, and why not one per cent less."""

from collections.abc import Iterator
from fractions import Fraction

from rarms_iac.app.explanation import Explanation, MemberCurve
from rarms_iac.model.indexes import find_index, show_threshold, show_value
from rarms_iac.model.quantities import show_percent
from rarms_iac.model.system import AtMost, Threshold
from rarms_iac.statistics.curves import Point, holds
from rarms_iac.statistics.verdicts import describe_error


def verdicts(walk: Explanation) -> Iterator[str]:
    """What was measured at the reservation, or why nothing was."""
    if walk.measured is None:
        yield _why_not_measured(walk)
        yield from walk.remarks
        return
    at = walk.least.reserve if walk.least is not None else max(walk.measured.reserves, default=0)
    for one in walk.looked:
        point = one.curve.value_at(at)
        if point is not None:
            yield _verdict(walk, one, point, at)
    if untold := sorted({each for one in walk.looked for each in one.curve.inconclusive}):
        yield f"measured without a verdict (no steady state, or too few answers): {_listed(untold)}"
    if walk.least is not None and walk.least.interpolated:
        below = max((reserve for reserve in walk.measured.reserves if reserve < walk.least.reserve), default=None)
        above = min((reserve for reserve in walk.measured.reserves if reserve > walk.least.reserve), default=None)
        yield (
            f"looked up on the curve between the settings at {below} % and {above} %, not measured itself: "
            f"`{walk.measured.again} --verify` measures it"
        )
    yield from walk.remarks


def one_less(walk: Explanation, less: int) -> Iterator[str]:
    """Why not one per cent less: the index that its curve shows to fail there."""
    missed = [
        (one, at)
        for one in walk.looked
        if (at := one.curve.value_at(less)) and not holds(one.curve, one.threshold, less)
    ]
    for one, point in missed:
        how = "measured" if any(at.reserve == less for at in one.curve.points) else "looked up"
        how = f"{how}, as what was measured there gave no verdict" if less in one.curve.inconclusive else how
        side = point.upper if isinstance(one.threshold, AtMost) else point.lower
        yield (
            f"{less} %, one less: {_name(walk, one)} {_value(one, point.value)} ({how}), and {_value(one, side)} "
            f"on the safe side; it must be {_beside(one)}"
        )
    if missed:
        return
    untold = sorted({at for one in walk.looked for at in one.curve.inconclusive if at <= less})
    if less in untold:
        yield f"{less} %, one less: it was measured, and gave no verdict, so nothing says that it would do"
    elif untold:
        yield (
            f"{less} %, one less: not measured; lower settings gave no verdict ({_listed(untold)}), so nothing says "
            "that it would do"
        )
    else:
        yield f"{less} %, one less: nothing so low was measured, so nothing says that it would do"


def shown(name: str, threshold: Threshold) -> str:
    """A threshold in words."""
    index = find_index(name)
    assert index is not None, "a manifest's APT names indexes that there are"
    return show_threshold(index, threshold)


def _why_not_measured(walk: Explanation) -> str:
    if walk.wanted is None:
        return "not measured: there is no data log that holds"
    if walk.fixed_by:
        met = (
            "nothing says whether its APT is met" if any(member.apt for member in walk.group.members) else "no APT asks"
        )
        return f"not measured: the reserve is fixed, and {met}"
    return "not measured: nothing is reserved, and no APT asks"


def _verdict(walk: Explanation, looked: MemberCurve, point: Point, at: int) -> str:
    seen = (
        f"at {at} %: {_name(walk, looked)} {_value(looked, point.value)}, "
        f"between {_value(looked, point.lower)} and {_value(looked, point.upper)} "
        f"(the truth lies outside in at most {_percent(looked.curve.error)} of cases{_samples(looked, point)})"
    )
    if holds(looked.curve, looked.threshold, at):
        return f"{seen}: met, as the safe side of that is {_beside(looked)}; {describe_error(looked.curve.error / 2)}"
    return f"{seen}: not met for sure, as the safe side of that is not {_beside(looked)}"


def _listed(reserves: list[int]) -> str:
    return ", ".join(f"{reserve} %" for reserve in reserves)


def _name(walk: Explanation, looked: MemberCurve) -> str:
    return looked.index if looked.member == walk.component.name else f"{looked.index} of {looked.member}"


def _samples(looked: MemberCurve, point: Point) -> str:
    found = [
        made.samples
        for at, made in zip(looked.curve.points, looked.curve.estimates, strict=True)
        if at.reserve == point.reserve
    ]
    return f", {found[0]} samples" if found else ""


def _beside(looked: MemberCurve) -> str:
    return shown(looked.index, looked.threshold)


def _value(looked: MemberCurve, value: float) -> str:
    index = find_index(looked.index)
    assert index is not None, "a curve is of an index that there is"
    if value in (float("inf"), float("-inf")):
        return "no bound"
    return show_value(index, Fraction(str(round(value, 1))))


def _percent(error: float) -> str:
    return show_percent(Fraction(error).limit_denominator(10_000) * 100)
