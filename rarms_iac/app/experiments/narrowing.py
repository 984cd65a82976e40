"""Fewer virtual processors for components that cannot use theirs: written, and measured again."""

from collections.abc import Callable, Iterator
from dataclasses import dataclass, replace

from rarms_iac.app.control import UNATTENDED, Control
from rarms_iac.app.experiments.level_prompt import SessionEnded
from rarms_iac.app.experiments.measure import MeasureOutcome, measure_components
from rarms_iac.app.experiments.measure_request import ExperimentResult, MeasureRequest
from rarms_iac.app.hosts import Hosts
from rarms_iac.app.manifest_edits import write_processors
from rarms_iac.model.outcomes import Sufficient
from rarms_iac.statistics.samples import usable_processors


@dataclass(frozen=True, slots=True, kw_only=True)
class Narrowing:
    """A component that was measured alone and cannot use all its virtual processors."""

    component: str
    before: int
    after: int  # on several platforms the most that it can use on any
    reserve: int  # the highest CR that it needs with as many as before, in whole per cent


NarrowingConsent = Callable[[Narrowing], bool]
"""Whether fewer processors of a component are written into the manifest; may raise `SessionEnded`."""


def always_narrows(_narrowing: Narrowing) -> bool:
    """Write all of them, as the options ask for.

    Args:
        _narrowing: not looked at.

    Returns:
        True.
    """
    return True


def narrow(
    hosts: Hosts,
    request: MeasureRequest,
    outcome: MeasureOutcome,
    consents: NarrowingConsent = always_narrows,
    control: Control = UNATTENDED,
) -> MeasureOutcome:
    """Write `processors` for components that cannot use all that they have, where that is wanted, and measure these.

    Args:
        hosts: Those that were measured on; the files of their manifest are written.
        request: How it was measured.
        outcome: What was measured; what it says of other components stands.
        consents: Asked for each component before its `processors` are written.
        control: The caller's part; its reporter hears what was written.

    Returns:
        What is known now; the same outcome where nothing was written.

    Raises:
        CannotFormat: The text is no manifest.
        UseCaseError: A file cannot be written (failed), or as measuring.
    """
    if outcome.stopped or outcome.ended:
        return outcome
    written: list[str] = []
    try:
        for narrowing in narrowings(outcome):
            if not consents(narrowing):
                continue
            file = write_processors(hosts.manifest, narrowing.component, narrowing.after)
            written.append(narrowing.component)
            control.reporter.message(
                f"Written to {file}: `processors: {narrowing.after}` for {narrowing.component}, which uses no more of "
                f"its {narrowing.before}. It is measured again."
            )
    except SessionEnded:
        return replace(outcome, ended=True)
    if not written:
        return outcome
    search = replace(request, components=tuple(written), together=False, coarse=False, again=False)
    return _merged(outcome, measure_components(hosts.reloaded(), search, control), written)


def narrowings(outcome: MeasureOutcome) -> Iterator[Narrowing]:
    """Yield each component that was measured alone and can use fewer virtual processors than it has on any platform.

    Args:
        outcome: What was measured.

    Yields:
        In the order in which they were measured.
    """
    alone: dict[str, list[tuple[int, int, int]]] = {}
    for result in outcome.experiments:
        setup = result.experiment.setup
        if len(setup.members) == 1 and isinstance(result.conclusion, Sufficient):
            usable = usable_processors(result.settings, setup.members[0], setup.processors) or setup.processors
            alone.setdefault(setup.members[0], []).append((setup.processors, usable, result.conclusion.reserve))
    for name, found in alone.items():
        before, after, reserve = (max(each) for each in zip(*found, strict=True))
        if after < min(processors for processors, _, _ in found):
            yield Narrowing(component=name, before=before, after=after, reserve=reserve)


def _merged(outcome: MeasureOutcome, after: MeasureOutcome, names: list[str]) -> MeasureOutcome:
    """What was measured anew, beside what still stands of the rest."""

    def stands(result: ExperimentResult) -> bool:
        return result.experiment.setup.members[0] not in names or len(result.experiment.setup.members) > 1

    addresses = {f"component/{name}" for name in names} | {
        f"host/{result.experiment.host.name}" for result in after.experiments
    }
    unchanged = [finding for finding in outcome.findings if finding.address not in addresses]
    return replace(
        after,
        experiments=(*filter(stands, outcome.experiments), *after.experiments),
        findings=(*unchanged, *after.findings),
    )
