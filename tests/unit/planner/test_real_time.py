"""Task classes on Linux hosts: what the kernel would refuse, or never stop, is found before anything is changed."""

import pytest

from rarms_iac.model.host import ProviderKind
from rarms_iac.model.system import ThreadsTask
from rarms_iac.planner.layout import plan_layout
from rarms_iac.planner.reservations import FixedReservations
from rarms_iac.running.thread_priorities import ThreadRule, rules_of
from tests.builders import a_component, a_host, a_system
from tests.planning import PLACES, route
from tests.strategies import state_with

HOST = a_host(provider=ProviderKind.LINUX)
VISION = a_component("vision", reserve="60 %", task="MotionControl")


def found(*components: object, real_time_percent: int | None = 95, deadline_percent: int | None = None) -> list[str]:
    state = state_with(HOST, real_time_percent=real_time_percent, deadline_percent=deadline_percent)
    system = a_system(hosts=[HOST], components=components)  # type: ignore[arg-type]
    planning = plan_layout(system, FixedReservations(), {HOST.name: state}, PLACES)
    return [f"{finding.code} {finding.detail}" for finding in planning.findings]


def test_budgets_over_the_kernels_part_are_found() -> None:
    speech = a_component("speech", reserve="36 %", task="SpeechRecognition")

    assert found(VISION, speech) == [
        "RARMS442 Partitions with task classes on onboard need 36 % (speech) + 60 % (vision) = 96 % of each processor. "
        "The kernel gives all of them 95 % (cpu.rt_runtime_us)."
    ]
    assert found(VISION, speech, real_time_percent=None) == []
    assert found(VISION, a_component("speech", reserve="35 %", task="SpeechRecognition")) == []
    assert found(VISION, a_component("speech", reserve="36 %")) == []


@pytest.mark.parametrize(("percent", "code"), [(None, []), (100, ["RARMS443"])])
def test_classes_for_threads_need_the_kernels_limit(percent: int | None, code: list[str]) -> None:
    arm = a_component("arm", reserve="20 %", task=ThreadsTask(task_class="MotionControl", threads=("controller*",)))

    assert [each.split()[0] for each in found(arm, VISION, deadline_percent=percent)] == code


def test_partition_has_the_priorities_of_its_threads() -> None:
    arm = a_component(
        "arm", reserve="20 %", task=ThreadsTask(task_class="MotionControl", threads=("controller*", "io"))
    )
    system = a_system(hosts=[HOST], components=[arm, VISION])

    wanted = route(system, state_with(HOST)).desired.state.partitions

    threads = {partition.settings.name: partition.settings.threads for partition in wanted}
    assert threads["vision"] == ""
    assert rules_of(threads["arm"]) == tuple(ThreadRule(name, 23) for name in ("controller*", "io"))
