"""A robot that was measured: the delivery robot's shapes with noise of a fixed seed, as data logs in memory.

Nothing of it is a simulation. It is there for tests of reports, plots and exports, which ask for many settings.
"""

from collections.abc import Callable, Hashable, Mapping, Sequence
from dataclasses import dataclass
from random import Random

from rarms_iac.app.report_measurements import ReportedLog, report_of
from rarms_iac.app.report_model import Measurement, Report
from rarms_iac.model.host import Host
from rarms_iac.model.quantities import CpuAmount, LogicalProcessors, ProcessorTime
from rarms_iac.model.series import Sample, Series
from rarms_iac.model.setting import Setting
from rarms_iac.model.system import Component, System
from rarms_iac.planner.reservations import FixedReservations, NotMeasured, names_of
from rarms_iac.planner.totals import planned_totals
from tests.builders import a_component, a_host, a_run, a_system, at_least, at_most
from tests.builders_measured import a_log, a_subject

Shape = Callable[[int], float]
"""The mean response time in ms at a reserve."""

RESERVES = (10, 20, 30, 40, 50, 60, 70, 80, 90, 100)


def face_detection(reserve: int) -> float:
    """Falls to its floor at 70 %, as in the paper's first figure."""
    return max(88.0, 26.4 + 61.6 * 70 / reserve)


def speech_recognition(reserve: int) -> float:
    """Work alone, without a floor."""
    return 50.0 * 100 / reserve


def path_planning(reserve: int) -> float:
    """Quick, and quicker with more."""
    return 12.0 + 900 / reserve


def a_measured_setting(name: str, reserve: int, shape: Shape, *, samples: int = 2000, within: float = 400.0) -> Setting:
    """Jobs one after the other, 5 % of noise; a job succeeds within a time."""
    random = Random(f"seed {name} {reserve}")
    began, jobs = 0.0, []
    for _ in range(samples):
        response = shape(reserve) * random.gauss(1.0, 0.05)
        jobs.append(Sample(began_ms=began, response_ms=response, successful=response <= within))
        began += response
    series = Series(component=name, samples=tuple(jobs), elapsed_ms=began, cpu_ms=began * reserve / 100)
    return Setting(reserve=reserve, series=(series,), beside=100 - reserve, seed=7)


def a_log_of(component: Component, shape: Shape, reserves: Sequence[int] = RESERVES) -> ReportedLog:
    """The component's log against busy loops."""
    settings = [a_measured_setting(component.name, reserve, shape) for reserve in reserves]
    return ReportedLog(
        path=f"measurements/onboard/{component.name}/busy-loop.jsonl", log=a_log(settings, a_subject(component))
    )


def a_robot() -> System:
    """Four components on a host of two LPs: three to be measured, one fixed."""
    components = (
        a_component(
            "face-detection", criticality=40, reserve="measured", run=a_run(), apt={"mean_response_time": at_most(100)}
        ),
        a_component(
            "speech-recognition",
            criticality=30,
            reserve="measured",
            run=a_run(),
            apt={"success_rate": at_least(95), "p95_response_time": at_most(400)},
        ),
        a_component("path-planning", criticality=20, reserve="measured", run=a_run(), apt={}),
        a_component("video-streaming", criticality=10, reserve="10 %"),
    )
    return a_system(hosts=[a_host("onboard", platform="onboard")], components=components)


def the_logs(system: System) -> tuple[ReportedLog, ...]:
    """A log of each component that is measured."""
    return (
        a_log_of(system.components["face-detection"], face_detection),
        a_log_of(system.components["speech-recognition"], speech_recognition, (8, 12, 16, 20, 30, 60, 100)),
        a_log_of(system.components["path-planning"], path_planning, (5, 10, 40)),
    )


def report_of_logs(system: System, logs: Sequence[ReportedLog]) -> Report:
    """What these logs say, on hosts that promise what they show and nothing else."""
    report = report_of(system, logs, (), planned_totals(system, FixedReservations(), {}))
    shown = _Shown({(each.platform, each.components): each for each in report.measurements if each.decides})
    return report_of(system, logs, (), planned_totals(system, shown, {}))


@dataclass(frozen=True)
class _Shown(FixedReservations):
    """Reservations as the measurements of a report show them."""

    measured: Mapping[tuple[str, tuple[str, ...]], Measurement]  # by platform and components

    def reservation(self, members: tuple[Component, ...], host: Host) -> CpuAmount | NotMeasured:
        measured = self.measured.get((host.platform, names_of(members)))
        if measured is None or measured.reserved_lp is None:
            return super().reservation(members, host)
        return ProcessorTime(LogicalProcessors(measured.reserved_lp))

    def processors(self, members: tuple[Component, ...], host: Host) -> int | None:  # type: ignore[override]  # there it is None
        measured = self.measured.get((host.platform, names_of(members)))
        return None if measured is None else measured.processors

    def depends_on(self, host: Host) -> Hashable:
        return host.logical_processors, host.platform
