"""The use scenario of the paper: after each experiment, somebody picks a level of performance from the curves."""

from collections.abc import Sequence
from dataclasses import replace
from typing import Protocol

from rarms_iac.app.errors import RequestError, UseCaseError
from rarms_iac.app.experiments import ExperimentResult
from rarms_iac.app.hosts import Hosts
from rarms_iac.app.manifests import load_manifest
from rarms_iac.app.report import report_of_manifest
from rarms_iac.app.report_model import Measurement
from rarms_iac.app.select import SelectOutcome, SelectRequest, select_level
from rarms_iac.measuring.strategies import apts_of
from rarms_iac.model.outcomes import Swept
from rarms_iac.statistics.curves import curves_of, least_reserve


class LevelPrompt(Protocol):
    """Asks somebody for the level of performance that is good enough; on a terminal, or on a page."""

    def show(self, result: ExperimentResult, measurements: Sequence[Measurement]) -> None:
        """Show the user what was measured, before `ask`.

        Args:
            result: the experiment that was just measured.
            measurements: the data logs with curves that a reservation rests on.
        """
        ...

    def ask(self, component: str) -> str:
        """Return the level for a component, as `100 ms` or `95 %`; empty: go on without one."""
        ...

    def refused(self, problem: RequestError | UseCaseError) -> None:
        """Tell why the level that was given cannot be had; the same component is asked again."""
        ...

    def written(self, outcome: SelectOutcome) -> None:
        """Tell what follows from the level, which now stands in the manifest."""
        ...


def ask_levels(hosts: Hosts, result: ExperimentResult, prompt: LevelPrompt) -> ExperimentResult:
    """Ask for a level of each component of an experiment, and write the answers into the manifest.

    Args:
        hosts: Those of the manifest, which is read anew for each level.
        result: What was measured.
        prompt: Shows it, and asks.

    Returns:
        The result beside the thresholds that the manifest has then; what was searched for others is left out.
    """
    source, names = hosts.manifest.source, result.experiment.setup.members
    measurements = report_of_manifest(hosts.manifest, names).measurements
    prompt.show(result, [measurement for measurement in measurements if measurement.rests])
    for name in names:
        while level := prompt.ask(name):
            try:
                prompt.written(select_level(load_manifest(source), SelectRequest(component=name, level=level)))
            except (RequestError, UseCaseError) as problem:
                prompt.refused(problem)
            else:
                break
    return _beside_new_thresholds(hosts, result)


def _beside_new_thresholds(hosts: Hosts, result: ExperimentResult) -> ExperimentResult:
    system = load_manifest(hosts.manifest.source).system
    before = result.experiment
    members = tuple(replace(member, apt=system.components[member.name].apt) for member in before.members)
    if members == before.members:
        return result
    experiment = replace(before, members=members)
    planned = least_reserve(curves_of(result.settings, experiment.runs, apts_of(experiment)))
    return replace(result, experiment=experiment, conclusion=Swept(), planned=planned)
