from rarms_iac.model.quantities import Percent, ShareOfHost
from tests import builders


def test_unsaid_fields_are_valid() -> None:
    component = builders.a_component("speech", reserve="30 %", memory="256 MiB")

    assert component.cpu.reserve == ShareOfHost(Percent(builders.percent("30 %")))
    assert component.memory == 256 * 2**20


def test_a_periodic_run_has_its_period_as_deadline() -> None:
    assert builders.a_run(every="33 ms").deadline == 33
    assert builders.a_run().deadline is None
