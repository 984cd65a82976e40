"""What an applied layout showed: every index beside its threshold, with the verdict on it."""

from collections import Counter
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import fields
from typing import assert_never

from rarms_iac.measuring.findings import show_threshold
from rarms_iac.measuring.prove import IndexVerdict, LayoutProof
from rarms_iac.model.diagnostics import Diagnostic
from rarms_iac.model.measurement import Series
from rarms_iac.model.outcomes import Met, Missed, TooFewSamples, TooManyFailures, Unsteady, Verdict, WithinNoise
from rarms_iac.statistics.verdicts import show_error
from rarms_iac.views.as_json import as_json
from rarms_iac.views.measured import index_outputs, show_band
from rarms_iac.views.output.measuring import ProvenIndexOutput, ProvenVerdict, ProveOutput
from rarms_iac.views.progress import WRITE_OVER, fitting
from rarms_iac.views.table import table


def proof_text(proofs: Sequence[LayoutProof], interference: str | None, width: int) -> str:
    """A table, a row an index, and a sentence."""
    if not any(proof.verdicts for proof in proofs):
        return "No component that ran has a threshold: nothing is proven.\n"
    rows = [("host", "partition", "component", "threshold", "measured", "verdict", "wrong in")]
    for proof in proofs:
        where = {member.name: name for name, members in proof.layout.partitions.items() for member in members}
        rows += [
            (
                proof.host,
                where.get(one.measured.component, "-"),
                one.measured.component,
                f"{one.measured.index} {show_threshold(one.measured.index, one.measured.threshold)}",
                show_band(one.measured),
                _in_words(one),
                "" if one.error is None else show_error(one.error),
            )
            for one in proof.verdicts
        ]
    against = f", against {interference}" if interference else ""
    counts = Counter(verdict_of(one.verdict) for proof in proofs for one in proof.not_met)
    says = ", ".join(f"{count} {verdict}" for verdict, count in sorted(counts.items())) or "all thresholds met"
    return table(_telling(rows), width) + f"\nAll components together{against}: {says}.\n"


def _telling(rows: Sequence[Sequence[str]]) -> Sequence[Sequence[str]]:
    """Without the host where there is one only, and without partitions that are all called as their components."""
    _, *told = rows
    hosts = {row[0] for row in told}
    alike = all(row[1] == row[2] for row in told)
    columns = [at for at in range(len(rows[0])) if not ((at == 0 and len(hosts) == 1) or (at == 1 and alike))]
    return [tuple(row[at] for at in columns) for row in rows]


def prove_json(proofs: Sequence[LayoutProof], interference: str | None, findings: tuple[Diagnostic, ...]) -> str:
    """The same for programs."""
    found = tuple(output for proof in proofs for output in _outputs(proof))
    met = not any(proof.not_met for proof in proofs)
    return as_json(ProveOutput(interference=interference, met=met, indexes=found, findings=findings))


def verdict_of(verdict: Verdict) -> ProvenVerdict:
    """What it is called wherever it is told."""
    match verdict:
        case Met():
            return "met"
        case Missed():
            return "missed"
        case WithinNoise():
            return "within the noise"
        case Unsteady():
            return "no steady state"
        case TooFewSamples() | TooManyFailures():
            return "cannot be told"
        case _:
            assert_never(verdict)


def sampled(host: str, seen: Mapping[str, Series], width: int) -> str:
    """A line of progress that is written over; empty where there is nothing to tell."""
    counts = ", ".join(f"{name} {len(series.samples)}" for name, series in sorted(seen.items()))
    return WRITE_OVER + (fitting(f"  {host}: samples of {counts}", width) if counts else "")


def _in_words(tried: IndexVerdict) -> str:
    """`met`; of an extreme, how many jobs may yet lie beyond it."""
    says, seen = verdict_of(tried.verdict), tried.measured.estimate
    if tried.error is None or seen is None or seen.beyond is None:
        return says
    return f"{says} so far (up to {seen.beyond:.2g} % of the jobs may lie beyond)"


def _outputs(proof: LayoutProof) -> Iterator[ProvenIndexOutput]:
    for one, shown in zip(proof.verdicts, index_outputs([one.measured for one in proof.verdicts]), strict=True):
        seen = {each.name: getattr(shown, each.name) for each in fields(shown)}
        yield ProvenIndexOutput(
            **seen,
            host=proof.host,
            verdict=verdict_of(one.verdict),
            verdict_error=one.error,
            why=one.measured.reason,
        )
