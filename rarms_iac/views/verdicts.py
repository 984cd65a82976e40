"""Verdicts in words, for all views, and `rarms prove`: every index of the applied layout with its verdict."""

from collections import Counter, defaultdict
from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import replace
from math import inf
from typing import TYPE_CHECKING, assert_never

from rarms_iac.app.report_model import ComponentProof, ComponentVerdict
from rarms_iac.measuring.proof import IndexVerdict, LayoutProof
from rarms_iac.measuring.prove import ProveOutcome, ProveRequest, continue_command
from rarms_iac.model.commands import DRIFT, MEASURE, Prose, Wording, prose
from rarms_iac.model.indexes import PerformanceIndex, index_named
from rarms_iac.model.outcomes import Achievement, Condition, RareRuns, RareSlowJobs, VerdictWord, verdict_word
from rarms_iac.model.series import MOST_SAMPLES, HeardMessages, SkippedLines
from rarms_iac.model.setting import join_heard, join_skipped
from rarms_iac.model.system import AtMost, Component, Threshold, run_of
from rarms_iac.running.reading import describe_skipped
from rarms_iac.statistics.distributions import describe_errors
from rarms_iac.texts.indexes import short_name, show_value
from rarms_iac.texts.messages import counted, in_a_row, list_names, natural_order
from rarms_iac.texts.quantities import show_number, show_processors
from rarms_iac.views.console import paragraph, stack
from rarms_iac.views.table import Column, Table

if TYPE_CHECKING:
    from rich.console import RenderableType


def describe_achievement(achievement: Achievement, not_measured: tuple[str, ...]) -> str:
    """Describe the verdict on a threshold or a component: `met`, `not measured with bursts-20`."""
    suffix = f" with {in_a_row(not_measured)}" if achievement is Achievement.UNMEASURED and not_measured else ""
    return f"{achievement}{suffix}"


def describe_verdicts(verdicts: Iterable[ComponentVerdict]) -> Iterator[str]:
    """Name the components of each verdict, worst first: `Inconclusive: vision (p95_response_time) and speech`."""
    for words, names in _by_words(verdicts, with_indexes=True).items():
        yield f"{words[:1].upper()}{words[1:]}: {in_a_row(names)}"


def _by_words(verdicts: Iterable[ComponentVerdict], *, with_indexes: bool) -> Mapping[str, Sequence[str]]:
    named: dict[str, dict[str, None]] = {}
    for verdict in sorted(verdicts, key=lambda each: tuple(Achievement).index(each.achievement), reverse=True):
        indexes = f" ({in_a_row(verdict.indexes)})" if with_indexes and verdict.achievement in _OF_INDEXES else ""
        words = describe_achievement(verdict.achievement, verdict.not_measured)
        named.setdefault(words, {})[f"{verdict.component}{indexes}"] = None
    return {words: tuple(names) for words, names in named.items()}


_OF_INDEXES = frozenset({Achievement.OPEN, Achievement.MISSED})


def describe_verdicts_of(verdicts: Iterable[ComponentVerdict], component: str) -> Iterator[str]:
    """Describe the verdict on a component, one for each platform: `inconclusive: p95_response_time`."""
    own = [verdict for verdict in verdicts if verdict.component == component]
    for verdict in own:
        suffix = f" on {verdict.platform}" if len(own) > 1 else ""
        indexes = f": {in_a_row(verdict.indexes)}" if verdict.achievement in _OF_INDEXES else ""
        yield f"{describe_achievement(verdict.achievement, verdict.not_measured)}{suffix}{indexes}"


def advise_to_measure(verdicts: Iterable[ComponentVerdict]) -> Prose | None:
    """Recommend the command that measures the rest; None: everything is measured."""
    if all(verdict.achievement is not Achievement.UNMEASURED for verdict in verdicts):
        return None
    return prose("Measure the missing reservations: ", MEASURE, ".")


def why_not_known(verdicts: Iterable[ComponentVerdict]) -> str:
    """Explain why a total is not known, worst first: `vision and speech are inconclusive; drive is not measured`."""
    return "; ".join(
        f"{list_names(names)} {'is' if len(names) == 1 else 'are'} {words}"
        for words, names in _by_words(verdicts, with_indexes=False).items()
    )


def show_bound(index: PerformanceIndex, threshold: Threshold) -> str:
    """Write a threshold as `<= 100 ms`, short enough for a table."""
    return f"{'<=' if isinstance(threshold, AtMost) else '>='} {show_value(index, threshold.value, threshold)}"


def short_bound(index: PerformanceIndex, threshold: Threshold) -> str:
    """Write as `p95 <= 100 ms` or `success_rate >= 99 %`, short enough for a table."""
    return f"{short_name(index)} {show_bound(index, threshold)}"


def share_of_threshold(value: float, threshold: Threshold) -> float:
    """Return how much of its threshold a value uses: 1 at the threshold, more where it misses."""
    bound = float(threshold.value)
    used, allowed = (value, bound) if isinstance(threshold, AtMost) else (bound, value)
    return used / allowed if allowed > 0 else inf


VERDICTS = (
    Column("component", wraps=True),
    Column("host", wraps=True, if_differs=True),
    Column("threshold", wraps=True),
    Column("measured", right=True),
    Column("load", wraps=True),
    Column("verdict", wraps=True),
)


def stopped_proof(outcome: ProveOutcome, request: ProveRequest, hosts: Sequence[str] = ()) -> Prose:
    """Say what a proof that was stopped leaves, and the command that goes on with it.

    Args:
        hosts: the chosen ones; none: all of the manifest.
    """
    loads = list(dict.fromkeys(proof.interference or "no load" for proof in outcome.proofs))
    following = continue_command(outcome, request, hosts)
    if not loads:
        return prose("Stopped before the first proof had ended. Nothing is proven. Start again: ", following, ".")
    rest = "Continue with the other loads: " if outcome.remaining else "Start again with all hosts: "
    return prose(f"Stopped. The proofs with {in_a_row(loads)} are saved. {rest}", following, ".")


def proof_text(outcome: ProveOutcome) -> "RenderableType":
    """Return a table a host and load, a row an index, and a sentence each; the next command if all is proven."""
    proofs = outcome.proofs
    if not any(proof.verdicts for proof in proofs):
        return paragraph("No component that ran has a threshold: nothing is proven.")
    rows = [
        _row(proof, verdict)
        for proof in proofs
        for verdict in sorted(proof.verdicts, key=lambda each: natural_order(each.measured.component))
    ]
    sharing = dict.fromkeys(sentence for proof in proofs for sentence in _describe_sharing(proof))
    conditions = describe_conditions(
        each.condition for proof in proofs for each in proof.verdicts if each.condition is not None
    )
    sentences: list[Wording] = [*map(_sentence, proofs)]
    if outcome.met:
        sentences[-1] = prose(sentences[-1], " Next: ", DRIFT)
    totals = [
        *sharing,
        *_describe_skipped(proofs),
        _describe_delays(proofs),
        conditions,
        _sureness(proofs),
    ]
    table = Table(VERDICTS, rows, totals=list(filter(None, totals)))
    return stack(table, *(paragraph(sentence, more=2) for sentence in sentences))


def skipped_sentence(component: Component, skipped: SkippedLines) -> str:
    """Return the number of lines that are not samples, with the first of them."""
    return f"{component.name}: {describe_skipped(run_of(component).samples, skipped)}."


def delay_sentence(messages: Mapping[str, HeardMessages]) -> str:
    """Return the delay of the subscriber that response times from messages contain; empty: none was measured."""
    delays = [
        f"{name} {show_number(heard.delay_ms)} ms (p99 {show_number(heard.p99_delay_ms)} ms)"
        for name, heard in sorted(messages.items(), key=lambda each: natural_order(each[0]))
        if heard.delay_ms is not None and heard.p99_delay_ms is not None
    ]
    return f"Delay of the message subscriber: {', '.join(delays)}." if delays else ""


def _describe_skipped(proofs: Sequence[LayoutProof]) -> Iterator[str]:
    skipped = join_skipped(evidence for proof in proofs for evidence in proof.evidence)
    components = {component.name: component for proof in proofs for component in proof.layout.components}
    return (skipped_sentence(components[name], skipped[name]) for name in sorted(skipped, key=natural_order))


def _describe_delays(proofs: Sequence[LayoutProof]) -> str:
    return delay_sentence(join_heard(evidence for proof in proofs for evidence in proof.evidence))


def _row(proof: LayoutProof, verdict: IndexVerdict) -> tuple[str, ...]:
    measured, index = verdict.measured, index_named(verdict.measured.index)
    value = "-" if measured.estimate is None else show_value(index, measured.estimate.value, measured.threshold)
    bound = short_bound(index, measured.threshold)
    return measured.component, proof.host, bound, value, proof.interference or "no load", _verdict(verdict)


def _verdict(verdict: IndexVerdict) -> str:
    measured = verdict.measured
    word = describe_verdict(index_named(measured.index), verdict_word(verdict.verdict))
    word += CONDITIONAL if verdict.condition else ""
    if measured.overload is not None:
        return f"{word}, {measured.reason}"
    return f"{word}: about {verdict.samples_needed} samples needed" if verdict.samples_needed else word


def describe_proof_setting(proof: ComponentProof) -> str:
    """Write as `2026-02-01 12:00:00 UTC, on onboard with 40 % of its VPs under busy-loop`."""
    with_load = f"under {proof.entry.interference}" if proof.entry.interference else "without load"
    return f"{proof_time(proof)}, on {proof.entry.host} with {proof.entry.reserve} % of its VPs {with_load}"


def proof_time(proof: ComponentProof) -> str:
    """Return the time of the proof to the second, as all times are shown: `2026-02-01 12:00:00 UTC`."""
    return f"{proof.entry.when[:10]} {proof.entry.when[11:19]} UTC"


def describe_verdict(index: PerformanceIndex, verdict: VerdictWord) -> str:
    """Write as `met`, `missed` or `inconclusive`; an extreme is `met so far`: the next job may do worse."""
    if verdict in NOT_SHOWN:
        return "inconclusive"
    return "met so far" if index.is_extreme and verdict == "met" else verdict


NOT_SHOWN: tuple[VerdictWord, ...] = ("inconclusive", "too few samples")
"""Verdicts that more samples may change."""


def _describe_sharing(proof: LayoutProof) -> Iterator[str]:
    """Yield a sentence a partition of several components."""
    for name, members in sorted(proof.layout.partitions.items(), key=lambda entry: natural_order(entry[0])):
        if len(members) > 1:
            yield f"{in_a_row([member.name for member in members])} share partition {name}."


def _sentence(proof: LayoutProof) -> str:
    counts = Counter(
        "inconclusive" if (word := verdict_word(each.verdict)) in NOT_SHOWN else word for each in proof.not_met
    )
    shortfalls = [
        f"{count} {'without a steady state' if word == 'no steady state' else word}"
        for word, count in sorted(counts.items())
    ]
    message = ", ".join(shortfalls) or "all thresholds met"
    layout = proof.layout
    count = len(layout.components)
    components = f"{count} components together" if count > 1 else "1 component"
    amount = f"{show_processors(layout.reserved)} of {show_processors(layout.host_processors)}"
    with_load = f"under {proof.interference}" if proof.interference else "without load"
    proven = "Not proven" if shortfalls else "Proven"
    starts = counted(proof.starts, "start")
    return f"{proven} on {proof.host}: {components} on {amount} {with_load}, {starts}, {message}."


def _sureness(proofs: Sequence[LayoutProof]) -> str:
    """Write the confidence of the verdicts."""
    verdicts = [(each, index_named(each.measured.index)) for proof in proofs for each in proof.verdicts]
    sure = any(each.error is not None and not index.is_extreme for each, index in verdicts)
    so_far = any(index.is_extreme and verdict_word(each.verdict) == "met" for each, index in verdicts)
    return describe_errors(sure=sure, so_far=so_far)


CONDITIONAL = "*"
"""Marks a measured value whose threshold is met on a condition; `describe_conditions` follows it."""


def describe_conditions(conditions: Iterable[Condition]) -> str:
    """Return the sentence below a table that has `CONDITIONAL`; empty without a condition.

    Of a component's conditions, also under several loads, it says one of each kind, from which the others follow.
    """
    strictest: dict[tuple[str, str], Condition] = {}
    for each in conditions:
        key = each.component, each.kind
        strictest[key] = _strictest(strictest.get(key, each), each)
    by_component: defaultdict[str, list[str]] = defaultdict(list)
    for (component, _), condition in strictest.items():
        by_component[component].append(_describe_condition(condition))
    parts = "; ".join(f"{component}: {' and '.join(said)}" for component, said in by_component.items())
    return f"{CONDITIONAL} Met if unseen slow jobs are rare. {parts}." if parts else ""


def _strictest(one: Condition, other: Condition) -> Condition:
    """Return a condition from which both follow; they are of one kind."""
    once_in = max(one.once_in, other.once_in)
    if isinstance(one, RareSlowJobs) and isinstance(other, RareSlowJobs):
        return replace(one, slower_than_ms=min(one.slower_than_ms, other.slower_than_ms), once_in=once_in)
    assert isinstance(one, RareRuns)
    assert isinstance(other, RareRuns)
    return replace(one, jobs=min(one.jobs, other.jobs), once_in=once_in)


def _describe_condition(condition: Condition) -> str:
    is_bounded = condition.once_in <= MOST_SAMPLES
    match condition:
        case RareSlowJobs(slower_than_ms=slowest):
            how_many = f"at most 1 job in {condition.once_in:,}" if is_bounded else "no job"
            return f"{how_many} slower than {show_value(index_named('maximum_response_time'), slowest)}"
        case RareRuns(jobs=jobs):
            what = f"run of {jobs} bad jobs"
            return f"at most 1 {what} in {condition.once_in:,} jobs" if is_bounded else f"no {what}"
        case _:
            assert_never(condition)
