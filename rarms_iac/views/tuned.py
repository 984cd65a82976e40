"""What tuning came to: partitions, the trail of settings, and the same for programs."""

from collections.abc import Iterator, Sequence
from fractions import Fraction

from rarms_iac.app.tune import TuningResult
from rarms_iac.model.diagnostics import Diagnostic
from rarms_iac.model.quantities import show_processors
from rarms_iac.planner.combining.oracle import Asked
from rarms_iac.planner.prediction.belief import ASSUMED
from rarms_iac.views.as_json import as_json
from rarms_iac.views.diagnostics.layout import wrap
from rarms_iac.views.output.combining import AskedOutput, CombinedOutput, TuneOutput
from rarms_iac.views.table import table


def tuned_text(tuned: TuningResult, width: int) -> str:
    """The trail, the partitions, and what all of it came to."""
    trail = table(list(_trail(tuned.trail)), width) + "\n" if tuned.trail else ""
    rows = [("partition", "components", "CR", "reserves", "apart")]
    for partition in tuned.partitions:
        names = ", ".join(partition.components)
        rows.append(
            (partition.name, names, f"{partition.reserve} %", _shown(partition.reserved), _shown(partition.parts))
        )
    says = "\n".join(wrap(_sentence(tuned), width, ""))
    return f"{trail}{table(rows, width)}\n{says}\n"


def _trail(trail: Sequence[Asked]) -> Iterator[tuple[str, ...]]:
    """Where nothing was predicted, there is no column of it."""
    predicted = [one.predicted for one in trail if one.predicted is not None]
    yield "setting", "CR", *(["predicted"] if predicted else []), "verdict"
    for one in trail:
        verdict = "all thresholds met" if one.passed else f"not met for sure by {', '.join(one.worse)}"
        told = "" if one.predicted is None else f"{one.predicted} %"
        yield "+".join(one.members), f"{one.reserve} %", *([told] if predicted else []), verdict


def _sentence(tuned: TuningResult) -> str:
    before, after, capacity = map(_shown, (tuned.before, tuned.after, tuned.capacity))
    match tuned.ending:
        case "nothing_to_do":
            return f"Nothing to do: {before} of {capacity} are reserved."
        case "stopped":
            return f"Stopped: {before} are reserved, and there are {capacity}."
        case "unable":
            return f"{tuned.message}: {before} are reserved, and there are {capacity}."
        case "successful":
            return f"{tuned.message}: {before} became {after} of {capacity}.{_claimed(tuned)}"


def _claimed(tuned: TuningResult) -> str:
    if tuned.proved:
        return f"\nNo other layout is better, if {ASSUMED}."
    if tuned.probability is None:
        return ""
    return (
        f"\n{tuned.claim.capitalize()}: so likely no other layout is better, as far as predictions have erred here. "
        "Without --probability the search goes on to the proof."
    )


def _shown(percent: int) -> str:
    return show_processors(Fraction(percent, 100))


def tuned_json(tuned: TuningResult, findings: Sequence[Diagnostic]) -> str:
    """The same for programs."""
    return as_json(
        TuneOutput(
            strategy=tuned.strategy,
            ending=tuned.ending,
            message=tuned.message,
            capacity=tuned.capacity,
            before=tuned.before,
            after=tuned.after,
            proved=tuned.proved,
            probability=tuned.probability,
            claim=tuned.claim,
            contradictions=tuned.contradictions,
            partitions=tuple(
                CombinedOutput(
                    name=partition.name,
                    components=partition.components,
                    processors=partition.processors,
                    reserve=partition.reserve,
                    reserved=partition.reserved,
                    parts_reserved=partition.parts,
                )
                for partition in tuned.partitions
            ),
            trail=tuple(
                AskedOutput(
                    components=one.members,
                    reserve=one.reserve,
                    met=one.passed,
                    worse=one.worse,
                    predicted=one.predicted,
                )
                for one in tuned.trail
            ),
            written=tuned.written,
            findings=tuple(findings),
        )
    )
