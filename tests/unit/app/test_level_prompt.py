"""The use scenario without a terminal: whoever shows its steps gets values, and answers with words."""

from collections.abc import Sequence
from datetime import date
from pathlib import Path

from rarms_iac.app.errors import RequestError, UseCaseError
from rarms_iac.app.experiments import ExperimentResult, MeasureRequest
from rarms_iac.app.hosts import select_hosts
from rarms_iac.app.manifests import load_manifest
from rarms_iac.app.measure import measure_components
from rarms_iac.app.report_model import Measurement
from rarms_iac.app.requests import HostSelection, ManifestSource
from rarms_iac.app.select import SelectOutcome
from tests.unit.app.test_measure import MANIFEST, write


class Page:
    """A `LevelPrompt` with answers that were given before; it keeps what it was to show."""

    def __init__(self, *answers: str) -> None:
        self._answers = list(answers)
        self.shown: list[str] = []

    def show(self, result: ExperimentResult, measurements: Sequence[Measurement]) -> None:
        self.shown += [f"{result.experiment.name}: {measurement.path}" for measurement in measurements]

    def ask(self, component: str) -> str:
        self.shown.append(f"level of {component}?")
        return self._answers.pop(0)

    def refused(self, problem: RequestError | UseCaseError) -> None:
        self.shown.append(f"no: {type(problem).__name__}")

    def written(self, outcome: SelectOutcome) -> None:
        self.shown.append(f"{outcome.selection.after.value} in {Path(outcome.file).name}")


def test_a_page_can_show_the_steps_of_the_use_scenario(tmp_path: Path) -> None:
    write(tmp_path, MANIFEST)
    source = ManifestSource(manifest=str(tmp_path), today=date(2026, 1, 1))
    hosts = select_hosts(load_manifest(source), HostSelection())
    page = Page("fast", "1 ms", "90 ms")

    outcome = measure_components(hosts, MeasureRequest(), prompt=page)

    assert page.shown == [
        "vision: measurements/onboard/vision/busy-loop.jsonl",
        "level of vision?",
        "no: RequestError",
        "level of vision?",
        "no: UseCaseError",
        "level of vision?",
        "90 in rarms.yaml",
    ]
    assert load_manifest(source).system.components["vision"].apt["mean_response_time"].value == 90
    assert not outcome.findings
