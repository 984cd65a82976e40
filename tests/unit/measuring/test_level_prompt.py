"""The use scenario without a terminal: a view of its steps gets values, and answers with words."""

from datetime import date
from pathlib import Path

from rarms_iac.app.hosts import select_hosts
from rarms_iac.app.manifests import load_manifest
from rarms_iac.app.report_model import Report
from rarms_iac.app.requests import HostSelection, ManifestSource
from rarms_iac.app.select import BeyondMeasured, Selection
from rarms_iac.app.use_case_errors import RequestError, UseCaseError
from rarms_iac.measuring.measure import measure_components
from rarms_iac.measuring.measure_request import ExperimentResult, MeasureRequest
from tests.unit.measuring.test_measure import MANIFEST, write


class Page:
    """A `LevelPrompt` with answers that were given before; it keeps what it was to show."""

    def __init__(self, *answers: str) -> None:
        self._answers = list(answers)
        self.shown: list[str] = []

    def show(self, result: ExperimentResult, report: Report) -> None:
        self.shown += [f"{result.experiment.name}: {measurement.log}" for measurement in report.measurements]

    def ask(self, component: str) -> str:
        self.shown.append(f"level of {component}?")
        return self._answers.pop(0)

    def confirms(self, proposed: Selection) -> bool:
        assert not proposed.file, "nothing is written yet"
        self.shown.append(f"write {proposed.after.value}?")
        return self._answers.pop(0) == "y"

    def refines(self, written: Selection) -> bool:
        self.shown.append(f"measure {[level.reserve for level in written.levels]}?")
        return self._answers.pop(0) == "y"

    def extends(self, beyond: BeyondMeasured) -> bool:
        self.shown.append(f"measure from {beyond.first} to {beyond.last}?")
        return self._answers.pop(0) == "y"

    def refused(self, problem: RequestError | UseCaseError) -> None:
        self.shown.append(f"no: {type(problem).__name__}")

    def written(self, outcome: Selection) -> None:
        self.shown.append(f"{outcome.after.value} in {Path(outcome.file).name}")


def test_page_can_show_steps_of_use_scenario(tmp_path: Path) -> None:
    write(tmp_path, MANIFEST)
    source = ManifestSource(manifest=str(tmp_path), today=date(2026, 1, 1))
    hosts = select_hosts(load_manifest(source), HostSelection())
    page = Page("fast", "1 ms", "n", "80 ms", "n", "90 ms", "y", "n")

    outcome = measure_components(hosts, MeasureRequest(), prompt=page)

    shown = [line for line in page.shown if not line.startswith("measure ")]  # whether the search passed there varies
    assert shown == [
        "vision: measurements/onboard/vision/busy-loop.jsonl",
        "level of vision?",
        "no: RequestError",
        "level of vision?",
        "no: BeyondMeasured",
        "level of vision?",
        "write 80?",
        "level of vision?",
        "write 90?",
        "90 in rarms.yaml",
    ]
    assert load_manifest(source).system.components["vision"].apt["mean_response_time"].value == 90
    assert not outcome.findings


def test_level_beyond_measured_is_measured_in_session(tmp_path: Path) -> None:
    write(tmp_path, MANIFEST)
    source = ManifestSource(manifest=str(tmp_path), today=date(2026, 1, 1))
    hosts = select_hosts(load_manifest(source), HostSelection())
    page = Page("60 ms", "n", "60 ms", "y", "y", "n", "")

    outcome = measure_components(hosts, MeasureRequest(reserves=(10, 20)), prompt=page)

    (result,) = outcome.experiments
    assert page.shown[1:4] == ["level of vision?", "no: BeyondMeasured", "measure from 21 to 100?"]
    assert page.shown[4:7] == ["level of vision?", "no: BeyondMeasured", "measure from 21 to 100?"]
    assert "write 60?" in page.shown[7:], "the level is looked up again without asking for it again"
    assert page.shown.count("level of vision?") == 2
    assert {21, 31, 100} <= {setting.reserve for setting in result.settings}
    assert load_manifest(source).system.components["vision"].apt["mean_response_time"].value == 60
