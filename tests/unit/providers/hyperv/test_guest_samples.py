"""What a guest's runner says of a job, as a sample."""

import json
from dataclasses import replace

import pytest

from rarms_iac.model.run import SampleCount, Samples, TimeField
from rarms_iac.model.system import run_of
from rarms_iac.providers.hyperv.guest_samples import FORMAT, GuestRun
from rarms_iac.providers.measuring import PartitionWork, Work
from tests.builders import a_component, at_least, at_most


@pytest.mark.parametrize(
    ("index", "failure"), [("mean_response_time", "it ended with exit code 2"), ("success_rate", "")]
)
def test_exit_code_is_a_failure_without_success_rate(index: str, failure: str) -> None:
    component = a_component(apt={index: at_least(95) if index == "success_rate" else at_most(50)})
    work = Work(
        application="robot",
        partitions=(PartitionWork(partition="p1", components=(component,)),),
        until={"vision": SampleCount(samples=1)},
        seed=0,
    )
    seen = iter(
        json.dumps({"format": FORMAT, "setting": "1", "name": "vision", "seen": text, "at_ms": 9})
        for text in ("started 10000", "ended 10000 50000 2")
    )

    ((_, sample),) = GuestRun(next_line=lambda: next(seen), setting="1", work=work).samples()

    assert (sample.successful, sample.failure) == (False, failure)


def test_guest_skips_and_refuses_lines_that_host_does() -> None:
    samples = Samples(source="pattern", pattern="took (?P<t>[0-9.]+)", response_time=TimeField(field="t", unit="ms"))
    component = a_component(run=replace(run_of(a_component()), samples=samples, failures=9))
    work = Work(
        application="robot",
        partitions=(PartitionWork(partition="p1", components=(component,)),),
        until={"vision": SampleCount(samples=3)},
        seed=0,
    )
    seen = iter(
        json.dumps({"format": FORMAT, "setting": "1", "name": "vision", "seen": text, "at_ms": 9})
        for text in (
            "started 10000",
            "line 20000 loading",
            "ended 10000 50000 2",
            "started 10000",
            "line 20000 took 1.5e3",
            "line 30000 took 12ms",
        )
    )

    found = [sample for _, sample in GuestRun(next_line=lambda: next(seen), setting="1", work=work).samples()]

    assert [sample.failure for sample in found] == [
        'it ended with exit code 2; 1 line did not match the pattern ("loading")',
        'the field "t" is "1.5", and only a part of "1.5e3"',
        "",
    ]
    assert found[-1].response_ms == 12
