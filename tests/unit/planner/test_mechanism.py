"""How a Linux host keeps a reservation, and what its kernel would refuse."""

from collections.abc import Iterable

import pytest

from rarms_iac.model.host import Host, LinuxHost, Mechanism, ProviderKind
from rarms_iac.model.layout import Layout, PlacedPartition
from rarms_iac.model.system import Component
from rarms_iac.planner.layout import Planning, plan_layout
from rarms_iac.planner.mechanism import deadline_percent, quota_period_us
from rarms_iac.planner.reservations import FixedReservations
from tests.builders import a_component, a_host, a_partition, a_system, at_most
from tests.planning import PLACES
from tests.strategies import state_with

APT = {"mean_response_time": at_most(88), "maximum_response_time": at_most(400)}
VISION = a_component("vision", reserve="35 %", apt=APT)
SPEECH = a_component("speech", reserve="20 %")


def a_linux_host(mechanism: Mechanism) -> Host:
    return a_host(provider=ProviderKind.LINUX, settings=LinuxHost(mechanism=mechanism))


def planned(
    host: Host, components: Iterable[Component], *, together: Iterable[str] = (), percent: int | None = None
) -> Planning:
    partitions = [a_partition("both", components=together)] if together else []
    states = {host.name: state_with(host, deadline_percent=percent)}
    system = a_system(hosts=[host], components=components, partitions=partitions)
    return plan_layout(system, FixedReservations(), states, PLACES)


def vision_with(mechanism: Mechanism, *, processors: int | None = None) -> PlacedPartition:
    vision = a_component("vision", reserve="35 %", apt=APT, processors=processors)
    answer = planned(a_linux_host(mechanism), [vision, SPEECH]).answer
    assert isinstance(answer, Layout)
    return next(partition for partition in answer.partitions if partition.name == "vision")


def test_linux_share_caps_nothing() -> None:
    found = vision_with(Mechanism.AUTOMATIC)

    settings = found.settings
    assert (settings.limit, settings.weight, settings.quota_period_us, settings.generation) == (100, 100, None, 0)
    assert found.why_weight == "Linux shares what is not reserved in proportion to the reservations"
    assert found.mechanism == "kept as a share, for then idle processors serve everybody (chosen by rarms)"


def test_quota_limits_within_the_threshold() -> None:
    found = vision_with(Mechanism.QUOTA)

    assert (found.settings.reserve, found.settings.limit, found.settings.quota_period_us) == (35, 35, 8_800)
    assert "the mechanism is quota" in found.why_limit
    assert found.mechanism.endswith("(the manifest says so)")


def test_fewer_processors_are_a_linux_quota() -> None:
    found = vision_with(Mechanism.SHARE, processors=1)

    assert (found.settings.processors, found.settings.limit, found.settings.quota_period_us) == (1, 100, 8_800)


@pytest.mark.parametrize(
    ("apt_ms", "quota_percent", "period_us"),
    [(88, 70, 8_800), (2, 70, 1_429), (5_000, 70, 100_000), (None, 70, 100_000), (10, 5, 20_000)],
)
def test_period_is_a_tenth_of_the_threshold(apt_ms: float | None, quota_percent: int, period_us: int) -> None:
    assert quota_period_us(apt_ms, quota_percent) == period_us


def test_deadline_gives_one_thread_everything() -> None:
    found = vision_with(Mechanism.DEADLINE)

    assert (found.settings.reserve, found.settings.limit, found.settings.quota_period_us) == (35, 100, None)
    assert (deadline_percent(35, 2), deadline_percent(60, 2)) == (70, 95)
    assert planned(a_linux_host(Mechanism.DEADLINE), [VISION, SPEECH]).findings == ()


@pytest.mark.parametrize(
    ("components", "together", "percent", "message"),
    [
        ([VISION, SPEECH], ("vision", "speech"), None, "both has 2 components, and a deadline is of one thread."),
        (
            [a_component("vision", task="MotionControl")],
            (),
            None,
            "vision has a task class, and a thread has either a deadline or a priority.",
        ),
        (
            [VISION, SPEECH],
            (),
            0,
            "The control groups of onboard hold only some of its 2 processors. "
            "The kernel refuses SCHED_DEADLINE to a thread that may not run on all of them.",
        ),
        (
            [VISION, SPEECH],
            (),
            50,
            "Deadlines on onboard need 40 % (speech) + 70 % (vision) = 110 % of a processor. "
            "The kernel admits 100 %: 50 % of each of 2 (sched_rt_runtime_us).",
        ),
    ],
)
def test_deadline_that_kernel_would_refuse_is_refused_before(
    components: list[Component], together: tuple[str, ...], percent: int | None, message: str
) -> None:
    findings = planned(a_linux_host(Mechanism.DEADLINE), components, together=together, percent=percent).findings

    assert [(finding.code, finding.detail) for finding in findings] == [("RARMS314", message)]
