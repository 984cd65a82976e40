from rarms_iac.model.quantities import Percent, ShareOfHost
from rarms_iac.model.system import Measured, RunsOn
from tests import builders


def test_what_is_not_said_is_valid_and_what_is_said_is_read_as_in_the_manifest() -> None:
    component = builders.a_component("speech", reserve="30 %", memory="256 MiB")

    assert component.cpu.reserve == ShareOfHost(Percent(builders.percent("30 %")))
    assert component.memory == 256 * 2**20


def test_a_measured_reserve_and_none_are_different_wishes() -> None:
    assert builders.a_component(reserve="measured").cpu.reserve is Measured.MEASURED
    assert builders.a_component(reserve=None).cpu.reserve is None
    assert builders.a_component(runs_on=RunsOn.HOST).cpu.reserve is None


def test_a_periodic_run_has_its_period_as_deadline() -> None:
    assert builders.a_run(every="33 ms").deadline == 33
    assert builders.a_run().deadline is None


def test_the_delivery_robot_promises_its_whole_host() -> None:
    robot = builders.the_delivery_robot()

    reserves = [component.cpu.reserve for component in robot.components.values()]

    assert [ShareOfHost(builders.percent(f"{n} %")) for n in (40, 30, 20, 10)] == reserves
