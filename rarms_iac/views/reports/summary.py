"""The summary: levels and bandwidths, a row a threshold, and each platform's total against its capacity."""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from fractions import Fraction

from rarms_iac.app.report_model import (
    ComponentProof,
    HostStatus,
    IndexCurve,
    MeasuredPoint,
    Measurement,
    PlatformCapacity,
    PlatformTuning,
    Report,
)
from rarms_iac.model.commands import APPLY, PLAN, Wording, command, prose
from rarms_iac.model.indexes import show_bound, show_range, show_threshold, show_value
from rarms_iac.model.quantities import guaranteed, plain, show_lp_percent, show_percent
from rarms_iac.planner.combining.candidates import ASSUMED, Node
from rarms_iac.statistics.error_probability import describe_error
from rarms_iac.views.prove import describe_verdict

MOST_CANDIDATES = 24


@dataclass(frozen=True, slots=True, kw_only=True)
class SummaryRow:
    """A component's level of performance and what it costs."""

    component: str
    index: str = ""
    level: str = ""  # the APT
    bound: str = ""  # the same as tables have it
    shows: str = ""  # what the curve says at the reserve
    reserve: str = ""
    processors: str = ""  # LPs
    verdict: str


def summary_rows(report: Report) -> tuple[SummaryRow, ...]:
    """Most critical first; what is fixed and what is not measured at the end."""
    return (
        *(_level(measurement, curve) for measurement, curve in deciding_curves(report)),
        *(_fixed(part.name, part.reserved_lp) for capacity in report.capacities for part in capacity.fixed),
        *(_unmeasured(names) for names in report.unmeasured),
    )


def deciding_curves(report: Report) -> Iterator[tuple[Measurement, IndexCurve]]:
    """Yield each curve with an APT that a reservation rests on, with its measurement, in the report's order."""
    for measurement in report.measurements:
        if measurement.rests:
            yield from ((measurement, curve) for curve in measurement.indexes if curve.threshold is not None)


def _level(measurement: Measurement, curve: IndexCurve) -> SummaryRow:
    assert curve.threshold is not None
    reserve = reserved_for(measurement, curve)
    point = None if reserve is None else curve.curve.value_at(reserve)
    return SummaryRow(
        component=curve.component,
        index=curve.index.name,
        level=show_threshold(curve.index, curve.threshold),
        bound=show_bound(curve.index, curve.threshold),
        shows="" if point is None else show_value(curve.index, point.value),
        reserve="none is enough" if reserve is None else show_percent(reserve),
        processors="" if reserve is None else plain(guaranteed(reserve, measurement.processors)),
        verdict=verdict_of(curve, reserve),
    )


def reserved_for(measurement: Measurement, curve: IndexCurve) -> int | None:
    """What the index's partition gets; where no reserve is enough for all its indexes, what this index alone needs."""
    if curve.least is None:
        return None
    return curve.least.reserve if measurement.reserve is None else measurement.reserve


def verdict_of(curve: IndexCurve, reserve: int | None) -> str:
    """What is known of the APT at this reserve, in words."""
    if reserve is None:
        return "not achieved at any reserve that was measured"
    points = [point for point in curve.points if point.reserve == reserve]
    return (
        f"measured: {points[-1].verdict or ''}{error_text(points[-1])}"
        if points
        else "interpolated: not itself measured"
    )


def error_text(point: MeasuredPoint) -> str:
    """How probably the verdict is wrong, as the end of a sentence; nothing where that is unknown."""
    return "" if point.error is None else f" ({describe_error(point.error)})"


def _fixed(name: str, amount: Fraction) -> SummaryRow:
    return SummaryRow(component=name, processors=plain(amount), verdict="fixed by the manifest")


def _unmeasured(names: tuple[str, ...]) -> SummaryRow:
    run = command("measure", *names, together=len(names) > 1)
    return SummaryRow(component=" + ".join(names), verdict=str(prose("not measured: run ", run)))


@dataclass(frozen=True, slots=True, kw_only=True)
class ProofRow:
    """A row of what was proven."""

    component: str
    index: str
    level: str
    bound: str  # the level as tables have it
    value: str
    shows: str  # the value with its interval
    met: bool
    verdict: str
    result: str  # the verdict with its error, and when it was given


def proof_rows(report: Report) -> tuple[ProofRow, ...]:
    """What all components showed together, in the report's order."""
    return tuple(_proof_row(proof) for proof in report.proofs)


def _proof_row(proof: ComponentProof) -> ProofRow:
    verdict = describe_verdict(proof.index, proof.verdict)
    return ProofRow(
        component=proof.component,
        index=proof.index.name,
        level=show_threshold(proof.index, proof.threshold),
        bound=show_bound(proof.index, proof.threshold),
        value="cannot be told" if proof.value is None else show_value(proof.index, proof.value),
        shows=_band(proof),
        met=proof.met,
        verdict=verdict + (" (outdated)" if proof.outdated else ""),
        result=verdict
        + ("" if proof.error is None else f" ({describe_error(proof.error)})")
        + (f": {proof.note}" if proof.note else "")
        + (f"; outdated: {'; '.join(proof.outdated)}" if proof.outdated else ""),
    )


def _band(proof: ComponentProof) -> str:
    """`94.1 ms, 93.5 to 94.8 ms`, as far as the samples tell."""
    if proof.value is None:
        return "cannot be told"
    value = show_value(proof.index, proof.value)
    if proof.lower is None or proof.upper is None:
        return value
    return f"{value}, {show_range(proof.index, proof.lower, proof.upper)}"


def fit_text(fit: PlatformCapacity) -> str:
    """As `70 % reserved of 100 % (1.4 LP of 2 LP). Headroom of onboard: 30 % (0.6 LP).`."""

    def share(amount: Fraction) -> str:
        return f"{_figure(100 * amount / fit.processors)} %"

    def processors(amount: Fraction) -> str:
        return f"{_figure(amount)} LP"

    headroom, capacity, hosts = fit.headroom_lp, fit.capacity_lp, ", ".join(fit.hosts)
    room = f"Headroom of {hosts}: {share(headroom)} ({processors(headroom)})"
    over = f"Over {hosts} by {share(-headroom)} ({processors(-headroom)})"
    return (
        f"{share(fit.reserved_lp)} reserved of {share(capacity)} "
        f"({processors(fit.reserved_lp)} of {processors(capacity)}). "
        f"{room if headroom >= 0 else over}."
    )


def tuning_text(tuning: PlatformTuning) -> str:
    """What came of it, and whether it is the best there is."""
    run = tuning.run
    before, after, capacity = (show_lp_percent(amount) for amount in (run.before, run.after, run.capacity))
    result = f"{before} became {after} of {capacity}" if run.before != run.after else f"{before} of {capacity}"
    proof = f" No other layout is better, if {ASSUMED}." if run.proved else ""
    broken = f" Nothing is proved: {'; '.join(run.contradictions)}." if run.contradictions else ""
    written = "" if run.written or run.ending != "successful" else " The manifest was left as it is."
    ending = (run.message or run.ending.replace("_", " ")).capitalize()
    outdated = "".join(f" {'+'.join(names)} is outdated: {why}." for names, why in tuning.outdated.items())
    return f"{ending}: {result} ({run.strategy} strategy, {run.when}).{proof}{broken}{written}{outdated}"


def trail_rows(tuning: PlatformTuning) -> tuple[tuple[str, str, str, str], ...]:
    """A row a setting that was asked for, in order: components, CR, what was predicted, answer."""
    return tuple(
        (
            " + ".join(setting.components) + _outdated(tuning, setting.components),
            show_percent(setting.reserve),
            "" if setting.predicted is None else show_percent(setting.predicted),
            f"not met for sure by {', '.join(setting.worse)}" if setting.worse else "all thresholds met",
        )
        for setting in tuning.run.trail
    )


def _outdated(tuning: PlatformTuning, components: Sequence[str]) -> str:
    return " (outdated)" if tuple(sorted(components)) in tuning.outdated else ""


def tuned_rows(tuning: PlatformTuning) -> tuple[tuple[str, str, str, str, str], ...]:
    """A row a partition as it was left: name, components, CR, its LPs, and those of the parts of a new one apart."""
    return tuple(
        (
            part.name,
            ", ".join(part.components) + _outdated(tuning, part.components),
            show_percent(part.reserve),
            plain(Fraction(part.reserved, 100)),
            "" if part.parts is None else plain(Fraction(part.parts, 100)),
        )
        for part in tuning.run.partitions
    )


def candidate_rows(report: Report) -> tuple[tuple[str, str], ...]:
    """List the compounds that could reserve less than their parts, at most `MOST_CANDIDATES`.

    Returns:
        A row a compound: its components, and what is known of the reserve of their common partition. Measured compounds
        come first, then those that may save most.
    """
    ranked = sorted(
        _compounds(report), key=lambda node: (not node.measured, node.low - node.high, len(node.members), node.name)
    )
    return tuple((" + ".join(node.members), node.label[-1]) for node in ranked[:MOST_CANDIDATES])


def candidates_left_out(report: Report) -> int:
    """Count the compounds that `candidate_rows` leaves out."""
    return max(0, len(_compounds(report)) - MOST_CANDIDATES)


def _compounds(report: Report) -> list[Node]:
    return [node for node in report.candidates if node.parts and node.is_gain]


def status_text(status: HostStatus) -> Wording:
    """Whether what the manifest asks for is on the host, and what brings it there."""
    if not status.is_planned:
        return prose("Nothing can be applied as it is: ", PLAN, " tells why.")
    if not status.differs:
        return "Applied: the host is as the manifest wants it."
    addresses_of: dict[str, list[str]] = {}
    for difference in status.differs:
        addresses_of.setdefault(difference.message, []).append(str(difference.address))
    parts = "; ".join(f"{message}: {', '.join(addresses)}" for message, addresses in addresses_of.items())
    return prose(f"{parts[:1].upper()}{parts[1:]}. ", PLAN, " shows what is to be done, ", APPLY, " does it.")


def _figure(value: Fraction) -> str:
    return f"{float(value):.2f}".rstrip("0").rstrip(".")
