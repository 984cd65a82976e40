from dataclasses import dataclass
from datetime import date
from pathlib import Path

from rarms_iac.manifest.checks import run_checks
from rarms_iac.manifest.checks.measurement import LogsInFolder
from rarms_iac.model.diagnostics import Severity
from rarms_iac.model.system import System
from tests.builders import PathPlaces, a_component, a_host, a_run, a_system, at_most, codes


@dataclass(frozen=True)
class Logs:
    """Data logs that are simply listed."""

    there: frozenset[tuple[str, str, str]] = frozenset()

    def exists(self, platform: str, component: str, interference: str) -> bool:
        return (platform, component, interference) in self.there


def measured() -> System:
    component = a_component("vision", reserve="measured", apt={"mean_response_time": at_most(100)}, run=a_run())
    return a_system(hosts=[a_host(platform="atom"), a_host("other", platform="xeon")], components=[component])


def test_a_reserve_that_is_not_measured_yet_is_a_warning_for_the_manifest_is_right() -> None:
    (told,) = run_checks(measured(), PathPlaces(), date(2026, 1, 1), logs=Logs())

    assert (told.code, told.severity) == ("RARMS101", Severity.WARNING)
    assert "measurements/atom/vision/busy-loop.jsonl" in told.detail


def test_a_log_on_one_platform_that_it_may_run_on_is_enough() -> None:
    logs = Logs(frozenset({("xeon", "vision", "busy-loop")}))

    assert run_checks(measured(), PathPlaces(), date(2026, 1, 1), logs=logs) == ()


def test_a_log_against_another_interference_is_none() -> None:
    logs = Logs(frozenset({("xeon", "vision", "browsers")}))

    assert codes(run_checks(measured(), PathPlaces(), date(2026, 1, 1), logs=logs)) == ["RARMS101"]


def test_a_fixed_reserve_needs_no_log_and_without_logs_to_ask_nothing_is_said() -> None:
    assert run_checks(a_system(), PathPlaces(), date(2026, 1, 1), logs=Logs()) == ()
    assert run_checks(measured(), PathPlaces(), date(2026, 1, 1)) == ()


def test_logs_lie_in_the_folder_of_platform_and_component(tmp_path: Path) -> None:
    log = tmp_path / "atom" / "vision" / "busy-loop.jsonl"
    log.parent.mkdir(parents=True)
    log.write_text("{}\n", encoding="utf-8", newline="\n")

    logs = LogsInFolder(tmp_path)

    assert logs.exists("atom", "vision", "busy-loop")
    assert not logs.exists("atom", "vision", "browsers")
    assert not LogsInFolder(tmp_path / "none").exists("atom", "vision", "busy-loop")
