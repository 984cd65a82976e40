"""Findings of a proof: every threshold that it did not show to be met, each miss with its ways out."""

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from fractions import Fraction
from math import ceil
from typing import Any, assert_never

from rarms_iac.app.hosts import Hosts
from rarms_iac.applying.desired_hosts import totals_after
from rarms_iac.measuring.evidence import MeasuredIndex
from rarms_iac.measuring.findings import MISSED, NO_MORE_CPU, NO_STEADY_STATE, NOT_RESOLVED, index_facts, show_index
from rarms_iac.measuring.proof import IndexVerdict, LayoutProof
from rarms_iac.model.commands import Wording, command, prose
from rarms_iac.model.diagnostics import Diagnostic, Facts
from rarms_iac.model.indexes import index_named
from rarms_iac.model.outcomes import Met, Missed, TooFewSamples, TooManyFailures, Unsteady, WithinNoise
from rarms_iac.model.quantities import Unit
from rarms_iac.model.series import MOST_SAMPLES
from rarms_iac.model.state import State
from rarms_iac.model.system import AtLeast, AtMost, Threshold
from rarms_iac.model.totals import host_totals
from rarms_iac.planner.groups import groups_of
from rarms_iac.statistics.curves import threshold_met_by
from rarms_iac.texts.findings import Finding
from rarms_iac.texts.indexes import show_threshold
from rarms_iac.texts.messages import counted, in_a_row
from rarms_iac.texts.quantities import show_duration, show_processors

HUNDREDTHS = 100
"""LPs are shown in hundredths, rounded up where they are asked for."""


@dataclass(frozen=True, slots=True, kw_only=True)
class WaysOut:
    """The ways for a component to meet the threshold that it missed in the layout."""

    helps: bool  # False: it waits for something else than a processor
    reserved_lp: Fraction | None  # of its partition; None: it has none, or runs in the host's own system
    asked_lp: Fraction | None  # that its slowdown asks for; None: unknown
    free_lp: Fraction  # that its host has left
    hosts: Mapping[str, Fraction]  # others that have what is asked for, with the LPs that they have left
    processors: int  # VPs of its partition; 0: it has none
    shares_with: tuple[str, ...]  # components in its partition
    holds: Threshold | None  # the tightest that was shown to be met; None: there is none

    @property
    def facts(self) -> Facts:
        """The values behind the ways out, as a finding carries them."""
        facts: dict[str, str | float | tuple[str, ...]] = {"free_lp": float(self.free_lp)}
        if self.asked_lp is not None:
            facts["asked_lp"] = float(self.asked_lp)
        if self.hosts:
            facts["other_hosts"] = tuple(self.hosts)
        if self.shares_with:
            facts["shares_with"] = self.shares_with
        if self.holds is not None:
            facts["threshold_that_holds"] = float(self.holds.value)
        return facts


def proof_findings(
    hosts: Hosts, proofs: Sequence[LayoutProof], states: Mapping[str, State], *, load_host: bool
) -> Iterator[Diagnostic]:
    """Report every threshold that a proof did not show to be met.

    Args:
        states: of all hosts that could be reached, as they were before the proof.
        load_host: whether the use of all idle time was asked for, so that it is recommended with the next proof.

    Returns:
        Findings in the order of the proofs; a miss has its ways out.
    """
    free = {name: _free_lp(hosts, name, state) for name, state in sorted(states.items())}
    more_samples = _more_samples(proofs, load_host=load_host)
    for proof in proofs:
        for verdict in proof.not_met:
            measured, ways = verdict.measured, _ways_out(hosts, proof, verdict, free)
            index, load = index_named(measured.index), proof.interference
            with_load = f" under {load}" if load else ""
            finding, advice = _finding_of(verdict, ways, more_samples)
            facts: dict[str, Any] = {**index_facts(measured), **({"interference": load} if load else {})}
            if verdict.samples_needed:
                facts["samples_needed"] = verdict.samples_needed
            if isinstance(verdict.verdict, Missed):
                facts |= ways.facts
            yield finding.at(
                hosts.manifest.places.value("components", measured.component, "apt", measured.index),
                "{component} on {host}{_with_load}: {_measured}; the threshold is {_asked}.",
                advice,
                address=f"component/{measured.component}",
                host=proof.host,
                _with_load=with_load,
                _measured=show_index(measured, helps=ways.helps),
                _asked=show_threshold(index, measured.threshold),
                **facts,
            )


def _finding_of(verdict: IndexVerdict, ways: WaysOut, more_samples: Wording) -> tuple[Finding, Wording]:
    """Return the finding for a verdict that is not met, and the advice with it."""
    match verdict.verdict:
        case Unsteady():
            return NO_STEADY_STATE, "Check for a growing queue or cache."
        case WithinNoise() | TooFewSamples() if verdict.samples_needed:
            return NOT_RESOLVED, more_samples
        case WithinNoise():
            return NOT_RESOLVED, _TOO_NEAR
        case TooFewSamples():
            return NOT_RESOLVED, f"{MOST_SAMPLES:,} samples would not be enough. Relax the threshold."
        case TooManyFailures():
            return (
                NOT_RESOLVED,
                "Correct the cause of the failed jobs, or allow more of them: `run: { failures: NUMBER }`.",
            )
        case Met() | Missed():
            return MISSED, _advice(verdict.measured, ways)
        case _:
            assert_never(verdict.verdict)


_TOO_NEAR = (
    "The measured value is too close to the threshold. More samples do not help. Raise the reservation, or relax "
    "the threshold."
)


def _more_samples(proofs: Sequence[LayoutProof], *, load_host: bool) -> Wording:
    """Advise one proof for all inconclusive thresholds, with the samples of the index that needs most."""
    many = max((verdict.samples_needed or 0 for proof in proofs for verdict in proof.not_met), default=0)
    takes = show_duration(many * sum(map(_sample_ms, proofs)))
    return prose(
        f"Take about {many} samples of each component, in about {takes}: ",
        command("prove", samples=many, load_host=load_host),
        ". Or raise the reservation.",
    )


def _sample_ms(proof: LayoutProof) -> float:
    """Return the user's waiting time for a sample of each component."""
    return 1000 * proof.wall_seconds / min((len(series.samples) or 1 for series in proof.series.values()), default=1)


def _advice(measured: MeasuredIndex, ways: WaysOut) -> Wording:
    """Write each way out as its own sentence."""
    if not ways.helps:
        return NO_MORE_CPU
    sentences = list(_reserves(measured, ways))
    if ways.shares_with:
        sentences.append(
            f"Give the component its own partition, without {in_a_row(ways.shares_with)}: `dedicated: true`."
        )
    if ways.holds is not None:
        sentences.append(f"A threshold of {show_threshold(index_named(measured.index), ways.holds)} was met.")
    again = command("measure", measured.component, again=True, stop_partitions=True)
    return prose(" ".join(sentences), " Or measure the reservation again: ", again, ".")


def _reserves(measured: MeasuredIndex, ways: WaysOut) -> Iterator[str]:
    if ways.reserved_lp is None:
        yield f"{measured.component} runs on the host itself without a reservation. Move it to a partition."
        return
    if ways.asked_lp is None:
        yield f"Raise the reservation: the host has {show_processors(ways.free_lp)} free."
        return
    asks = f"about {show_processors(ways.asked_lp)}, but its partition has {show_processors(ways.reserved_lp)}"
    more = ways.asked_lp - ways.reserved_lp
    why = "Its demand is" if measured.overload else "At this slowdown it needs"
    if more <= ways.free_lp:
        yield f"{why} {asks}. Raise the reservation: the host has {show_processors(ways.free_lp)} free."
    else:
        yield f"{why} {asks}. The host has only {show_processors(ways.free_lp)} free."
    if 0 < ways.processors < ways.asked_lp:
        yield f"That is more than {counted(ways.processors, 'virtual processor')} can give. Raise `processors`."
    for name, free in ways.hosts.items():
        yield f"Or move the component to {name}, which has {show_processors(free)} free."


def _ways_out(hosts: Hosts, proof: LayoutProof, verdict: IndexVerdict, free: Mapping[str, Fraction]) -> WaysOut:
    measured, layout = verdict.measured, proof.layout
    name = measured.component
    partition = layout.partition_of(name)
    reserved = layout.reserves.get(partition)
    reserved_lp = None if reserved is None else Fraction(reserved).limit_denominator(HUNDREDTHS**2)
    others = tuple(member.name for member in layout.partitions.get(partition, ()) if member.name != name)
    asked = None if reserved_lp is None else _asked_lp(measured, reserved_lp)
    component = hosts.system.components[name]
    elsewhere = {
        other: free_lp
        for other, free_lp in free.items()
        if asked is not None and other != proof.host and component.may_run_on(other) and free_lp >= asked
    }
    return WaysOut(
        helps=measured.overload is None or layout.more_processors_help(name, measured.overload),
        reserved_lp=reserved_lp,
        asked_lp=asked,
        free_lp=free.get(proof.host, Fraction(0)),
        hosts=elsewhere,
        processors=layout.processors.get(partition, 0),
        shares_with=others,
        holds=_threshold_that_held(measured),
    )


def _asked_lp(measured: MeasuredIndex, reserved_lp: Fraction) -> Fraction | None:
    """Return the LPs that it would need for its threshold, if its time is in inverse proportion to what it gets."""
    if measured.overload is not None:
        needed = measured.overload.needed_lp
        return None if needed is None else _round_up(needed)
    estimate, limit = measured.estimate, float(measured.threshold.value)
    if estimate is None or estimate.value <= 0.0 or limit <= 0.0:
        return None
    match index_named(measured.index).unit, measured.threshold:
        case Unit.TIME, AtMost():
            slowdown = estimate.value / limit
        case Unit.RATE, AtLeast():
            slowdown = limit / estimate.value
        case _:
            return None
    return _round_up(float(reserved_lp) * slowdown) if slowdown > 1.0 else None


def _round_up(lp: float) -> Fraction:
    return Fraction(ceil(lp * HUNDREDTHS), HUNDREDTHS)


def _threshold_that_held(measured: MeasuredIndex) -> Threshold | None:
    if measured.estimate is None:
        return None
    smaller_is_better = index_named(measured.index).smaller_is_better
    safe = measured.estimate.upper if smaller_is_better else measured.estimate.lower
    return threshold_met_by(measured.index, safe)


def _free_lp(hosts: Hosts, name: str, state: State) -> Fraction:
    system = hosts.system
    named = [group.name for group in groups_of(system)]
    return host_totals(system.hosts[name], state.facts, totals_after(state, system.application.name, (), named)).free_lp
