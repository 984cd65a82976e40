"""Fewer virtual processors for components that cannot use theirs: written, and measured again."""

from collections.abc import Callable
from dataclasses import dataclass, replace

from rarms_iac.app.experiments import ExperimentResult, MeasureRequest
from rarms_iac.app.hosts import Hosts
from rarms_iac.app.manifest_edits import write_processors
from rarms_iac.app.measure import MeasureOutcome
from rarms_iac.model.outcomes import Sufficient
from rarms_iac.statistics.parallelism import usable_processors


@dataclass(frozen=True, slots=True, kw_only=True)
class Narrowing:
    """What was written of a component."""

    component: str
    before: int
    after: int
    file: str


def narrow(hosts: Hosts, outcome: MeasureOutcome) -> tuple[Narrowing, ...]:
    """Write `processors` for each component that was measured alone and cannot use all that it has.

    Args:
        hosts: Those that were measured on; the files of their manifest are written.
        outcome: What was measured.

    Returns:
        What was written; of a component on several platforms the most that it can use on any.

    Raises:
        CannotFormat: The text is no manifest.
        UseCaseError: A file cannot be written (failed).
    """
    found: dict[str, list[tuple[int, int]]] = {}
    for result in outcome.results:
        setup = result.experiment.setup
        if len(setup.members) == 1 and isinstance(result.conclusion, Sufficient):
            usable = usable_processors(result.settings, setup.members[0], setup.processors) or setup.processors
            found.setdefault(setup.members[0], []).append((setup.processors, usable))
    return tuple(
        Narrowing(component=name, before=before, after=after, file=write_processors(hosts.manifest, name, after))
        for name, pairs in found.items()
        for before, after in [(max(before for before, _ in pairs), max(after for _, after in pairs))]
        if after < min(before for before, _ in pairs)
    )


def measure_narrowed(
    narrowed: tuple[Narrowing, ...],
    request: MeasureRequest,
    outcome: MeasureOutcome,
    measure: Callable[[MeasureRequest], MeasureOutcome],
) -> MeasureOutcome:
    """Measure again what was narrowed, with the manifest as it is now.

    Args:
        narrowed: What was written.
        request: How it was measured.
        outcome: What was measured before; what it says of other components stands.
        measure: Measures with the manifest as it is now.
    """
    names = tuple(narrowing.component for narrowing in narrowed)
    after = measure(replace(request, components=names))

    def stands(result: ExperimentResult) -> bool:
        return result.experiment.setup.members[0] not in names or len(result.experiment.setup.members) > 1

    addresses = {f"component/{name}" for name in names}
    kept = [finding for finding in outcome.findings if finding.address not in addresses]
    return replace(
        after,
        results=(*filter(stands, outcome.results), *after.results),
        findings=(*kept, *after.findings),
    )
