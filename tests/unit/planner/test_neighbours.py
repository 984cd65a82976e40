"""Thresholds that other partitions of a host decide."""

from collections.abc import Mapping, Sequence
from dataclasses import replace

import pytest

from rarms_iac.model.host import Host, ProviderKind
from rarms_iac.model.system import Component, Policy, System, Threshold
from rarms_iac.planner.layout import plan_layout
from rarms_iac.planner.measured_together import MeasuredTogether
from rarms_iac.planner.reservations import MeasuredReservations
from rarms_iac.statistics.curves import curve_of
from tests.builders import PathPlaces, a_component, a_host, a_run, a_simulation, a_system, at_least, at_most
from tests.builders_measured import a_log, a_series, a_setting

JOBS = [10.0, 10.2, 9.8] * 400
OTHER = a_component("other", reserve="20 %")


def measured(*, work_ms: float = 4.0, load: str = "busy-loop") -> MeasuredTogether:
    """40 % of two processors is enough for each threshold; a job takes so much processor time, on one of them."""
    series = replace(a_series("vision", JOBS), elapsed_ms=10_000.0)
    return MeasuredTogether(
        path=f"measurements/onboard/vision/{load}.jsonl",
        interference=load,
        processors=2,
        measured=(40,),
        curves=lambda component, index: curve_of([a_setting(40, series)], component, index, a_run()),
        records=a_log(()),
        cpu_ms=lambda _component: work_ms,
        used=1,
    )


def vision(apt: Mapping[str, Threshold], **changes: object) -> Component:
    component = a_component("vision", reserve="measured", apt=apt, run=a_run())
    return replace(component, **changes)  # type: ignore[arg-type]  # by name, as the builders take them


def found(
    component: Component,
    *,
    others: Sequence[Component] = (OTHER,),
    loads: Sequence[str] = ("busy-loop",),
    work_ms: float = 4.0,
    host: Host | None = None,
) -> list[tuple[str, str]]:
    """Severity and detail of what is said of neighbours."""
    system: System = a_system(
        hosts=[host or a_host()], components=[component, *others], policy=Policy(interference=tuple(loads))
    )
    logs = tuple(measured(work_ms=work_ms, load=load) for load in loads)
    source = MeasuredReservations(kinds={"onboard": "onboard"}, logs={("onboard", ("vision",)): logs})
    planning = plan_layout(system, source, {}, PathPlaces())
    return [
        (finding.severity.value, finding.detail)
        for finding in planning.findings
        if finding.code in {"RARMS313", "RARMS324"}
    ]


TAIL = {"p95_response_time": at_most(60)}
MEAN = {"mean_response_time": at_most(60)}
PERIODIC = a_run(every="50 ms")


def test_steady_loads_alone_warn_of_a_tail() -> None:
    ((severity, detail),) = found(vision(TAIL))

    assert severity == "warning"
    assert "may answer 110 ms after they are due: 10 ms of work by its reservation, and a window of 100 ms" in detail
    assert detail.endswith("p95_response_time allows less.")


def test_bursts_note_neighbours_of_a_tail() -> None:
    ((severity, detail),) = found(vision(TAIL), loads=("busy-loop", "bursts-20"))

    assert severity == "note"
    assert detail == (
        "p95_response_time of vision depends on its neighbours: what 1 other partition on onboard does within 100 ms "
        "decides it."
    )


@pytest.mark.parametrize(
    ("component", "count"),
    [
        (vision({"p95_response_time": at_most(111)}), 0),  # 10 ms of work and a window
        (vision(MEAN), 0),  # the next job begins when the last one ended: the share it gets is the share it has
        (vision(MEAN, run=PERIODIC), 1),
        (vision({"mean_response_time": at_most(111)}, run=PERIODIC), 0),
        (vision({"maximum_response_time": at_most(60)}), 1),
        (vision({"deadline_miss_rate": at_most(5)}, run=a_run(every="50 ms", deadline="50 ms")), 1),
        (vision({"success_rate": at_least(90)}, simulation=a_simulation(within="60 ms")), 1),
        (vision({"success_rate": at_least(90)}), 0),  # nothing says by when
    ],
)
def test_too_little_for_window_is_told(component: Component, count: int) -> None:
    assert len(found(component)) == count


def test_who_is_alone_on_host_has_no_neighbours() -> None:
    assert found(vision(TAIL), others=()) == []


def test_long_job_sees_whole_windows() -> None:
    assert found(vision({"p95_response_time": at_most(260)}), work_ms=100.0) == []


def test_linux_keeps_no_long_claim() -> None:
    linux = replace(a_host(), provider=ProviderKind.LINUX)

    assert found(vision(TAIL), host=linux) == []
