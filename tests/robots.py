"""Robots for tests: in memory with data logs, as a folder that was measured and applied, a small cell, and a fleet.

`applied_delivery_robot` goes the route of the shipped delivery robot once a process; tests take a copy of its folder.
"""

from collections.abc import Callable, Hashable, Sequence
from contextlib import chdir
from functools import cache
from pathlib import Path
from random import Random
from tempfile import TemporaryDirectory

from rarms_iac.app.data_logs import curves_in
from rarms_iac.app.report_measurements import ReportedLog, report_of
from rarms_iac.app.report_model import Report
from rarms_iac.model.series import Sample, Series
from rarms_iac.model.setting import Setting
from rarms_iac.model.system import Component, System
from rarms_iac.planner.groups import groups_of
from rarms_iac.planner.planning_findings import STALE
from rarms_iac.planner.reservations import MeasuredReservations, names_of
from rarms_iac.planner.totals import planned_totals
from rarms_iac.planner.verdicts import LogOfLoad, MeasuredTogether, NotMeasured, not_measured, without_log
from tests.builders import a_component, a_host, a_run, a_system, at_least, at_most
from tests.builders_measured import a_log, a_subject
from tests.files import copy_files
from tests.needs import CHECKOUT
from tests.unit.cli.running import rarms

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
        a_component("path-planning", criticality=20, reserve=None, run=a_run(), apt={}),
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
    reservations = reservations_of_logs(system, logs)
    return report_of(system, logs, (), planned_totals(system, reservations, {}), reservations)


def reservations_of_logs(system: System, logs: Sequence[ReportedLog]) -> MeasuredReservations:
    """Reservations as a plan takes them from these logs."""
    kinds = {name: host.platform for name, host in system.hosts.items()}
    found: dict[tuple[Hashable, tuple[str, ...]], tuple[LogOfLoad, ...]] = {}
    for group in groups_of(system):
        names = names_of(group.members)
        for platform in set(kinds.values()):
            found[platform, names] = tuple(_log(system, logs, platform, names, load) for load in system.loads_of(names))
    return MeasuredReservations(kinds=kinds, logs=found)


def _log(system: System, logs: Sequence[ReportedLog], platform: str, names: tuple[str, ...], load: str) -> LogOfLoad:
    for logged in logs:
        setup = logged.log.header.setup
        if (logged.log.header.platform, setup.members, setup.interference) != (platform, names, load):
            continue
        if logged.stale:
            return not_measured(STALE, names, platform, "It is stale.", "Measure again.", load=load)
        return MeasuredTogether(
            path=logged.path,
            interference=load,
            processors=setup.processors,
            measured=tuple(sorted({setting.reserve for setting in logged.log.settings})),
            curves=curves_in(logged.log, system.components),
            records=logged.log,
        )
    return NotMeasured(interference=load, why=without_log(names, platform).why)


@cache
def _applied() -> TemporaryDirectory[str]:
    """Measure and apply the delivery robot in a folder that is removed when the process ends."""
    folder = TemporaryDirectory(prefix="rarms-robot-")
    copy_files(CHECKOUT / "manifests" / "delivery-robot", Path(folder.name))
    with chdir(folder.name):
        assert rarms("measure").code == 0
        assert rarms("apply", "--auto-approve").code == 0
    return folder


def applied_delivery_robot(folder: Path) -> Path:
    """Copy the shipped delivery robot, measured and applied, into a folder."""
    return copy_files(Path(_applied().name), folder)


def a_measured(
    name: str = "vision",
    *,
    criticality: int = 30,
    at_most: str = "50 ms",
    until: str = "samples: 60",
    reserve: str = "measured",
    processors: int | None = 2,
    simulation: str = "work: 20 ms, varies: 2 %",
) -> str:
    """Return the entry of a component that is started once a sample; without `processors` it has no such key."""
    return (
        f"  {name}:\n    criticality: {criticality}\n"
        f"    apt: {{ mean_response_time: {{ at_most: {at_most} }} }}\n"
        f"    run: {{ command: [{name}], until: {{ {until} }}, samples: {{ from: per_run }} }}\n"
        f"    cpu: {{ reserve: {reserve} }}\n    memory: 512 MiB\n"
        + (f"    processors: {processors}\n" if processors else "")
        + f"    simulation: {{ {simulation} }}\n"
    )


def a_robot_of(
    *entries: str,
    name: str = "robot",
    policy: str = "interference: busy-loop",
    hosts: str = "onboard: { logical_processors: 2, memory: 4 GiB }",
) -> str:
    """Return a manifest's text with these entries of components on simulated hosts."""
    return (
        f"schema: rarms/v1\napplication: {{ name: {name} }}\npolicy: {{ {policy} }}\nhosts:\n  {hosts}\n"
        f"components:\n{''.join(entries)}"
    )


CELL = """\
schema: rarms/v1

application: { name: cell }
policy: { interference: busy-loop }

hosts:
  onboard: { logical_processors: 2, memory: 4 GiB }

components:
  vision:
    criticality: 30
    apt: { mean_response_time: { at_most: 41 ms } }
    memory: 512 MiB
    processors: 2
    cpu: { reserve: measured }
    simulation: { work: 20 ms, varies: 2 % }

  paths:
    criticality: 20
    apt: { mean_response_time: { at_most: 65 ms } }
    memory: 512 MiB
    processors: 2
    cpu: { reserve: measured }
    simulation: { work: 20 ms, varies: 2 % }

  video:
    criticality: 10
    apt: { mean_response_time: { at_most: 75 ms } }
    memory: 512 MiB
    processors: 2
    cpu: { reserve: measured }
    simulation: { work: 20 ms, varies: 2 % }
"""


def fleet_manifest(components: int) -> str:
    """Its text; every component differs in name and numbers, and all of them fit."""
    hosts = max(1, components // 20)
    lines = ["schema: rarms/v1", "", "application:", "  name: fleet", "", "hosts:"]
    for number in range(hosts):
        lines += [f"  cell-{number:04}:", "    provider: simulated", "    platform: cell"]
        lines += ["    logical_processors: 8", "    memory: 32 GiB"]
    lines += ["", "components:"]
    for number in range(components):
        lines += _component(number)
    return "\n".join(lines) + "\n"


def _component(number: int) -> list[str]:
    return [
        f"  component-{number:04}:            # number {number} of the line",
        f"    criticality: {1 + number % 97}",
        "    apt:",
        f"      mean_response_time: {{ at_most: {50 + number % 50} ms }}",
        "    run:",
        f"      command: [python3, components/c{number:04}.py]",
        "      until: { samples: 200 }",
        "      samples: { from: json_lines, response_time: { field: response, unit: ms } }",
        f"    memory: {256 + number % 4 * 64} MiB",
        "    cpu:",
        f"      reserve: {1 + number % 5} %",
        "      weight: 100",
        "    processors: 2",
    ]
