"""What a guest's runner says of a job, as a sample."""

import json

import pytest

from rarms_iac.model.run import SampleCount
from rarms_iac.providers.hyperv.guest_samples import FORMAT, GuestRun
from rarms_iac.providers.measuring import PartitionWork, Work
from tests.builders import a_component, at_least, at_most


@pytest.mark.parametrize(
    ("index", "failure"), [("mean_response_time", "it ended with exit code 2"), ("success_rate", "")]
)
def test_an_exit_code_is_a_failed_sample_where_no_success_rate_is_asked_for(index: str, failure: str) -> None:
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
