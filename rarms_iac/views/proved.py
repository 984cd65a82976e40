"""What an applied layout showed: every index beside its threshold."""

from collections.abc import Mapping, Sequence

from rarms_iac.experiments.measured import Shown
from rarms_iac.experiments.proving import Proof
from rarms_iac.experiments.telling import show_threshold
from rarms_iac.model.diagnostics import Diagnostic
from rarms_iac.model.measurement import Series
from rarms_iac.model.system import AtMost
from rarms_iac.views.as_json import as_json
from rarms_iac.views.measured import index_outputs, show_band
from rarms_iac.views.output import ProveOutput
from rarms_iac.views.progress import WRITE_OVER, fitting
from rarms_iac.views.table import table


def proof_text(proofs: Sequence[Proof], interference: str | None) -> str:
    """A table, a row an index, and a sentence."""
    rows = [("host", "partition", "component", "threshold", "measured", "verdict")]
    for proof in proofs:
        where = {one.name: name for name, members in proof.layout.partitions.items() for one in members}
        rows += [
            (
                proof.host,
                where.get(one.component, "-"),
                one.component,
                f"{one.index} {show_threshold(one.index, one.threshold)}",
                show_band(one),
                _verdict(one),
            )
            for one in proof.shown
        ]
    against = f", against {interference}" if interference else ""
    missed = sum(len(proof.missed) for proof in proofs)
    says = f"{missed} missed" if missed else "all thresholds met"
    return table(rows) + f"\nAll components together{against}: {says}.\n"


def prove_json(proofs: Sequence[Proof], interference: str | None, findings: tuple[Diagnostic, ...]) -> str:
    """The same for programs."""
    found = tuple(one for proof in proofs for one in index_outputs(proof.shown))
    met = not any(proof.missed for proof in proofs)
    return as_json(ProveOutput(interference=interference, met=met, indexes=found, findings=findings))


def sampled(host: str, seen: Mapping[str, Series], width: int) -> str:
    """A line of progress that is written over; empty where there is nothing to tell."""
    counts = ", ".join(f"{name} {len(one.samples)}" for name, one in sorted(seen.items()))
    return WRITE_OVER + (fitting(f"  {host}: samples of {counts}", width) if counts else "")


def _verdict(one: Shown) -> str:
    """Told by the value; where the band crosses the threshold, that is said."""
    if one.estimate is None:
        return "missed"
    says = "missed" if one.misses else "met"
    limit = float(one.threshold.value)
    worst = one.estimate.upper if isinstance(one.threshold, AtMost) else one.estimate.lower
    best = one.estimate.lower if isinstance(one.threshold, AtMost) else one.estimate.upper
    crosses = min(worst, best) < limit < max(worst, best) and one.estimate.beyond is None
    return f"{says}, within the noise" if crosses else says
