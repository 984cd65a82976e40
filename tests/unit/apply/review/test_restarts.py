import pytest

from rarms_iac.apply.review.restarts import restarts
from rarms_iac.model.changes import Address, Delete, Reason, Update
from rarms_iac.model.system import Disruption
from tests.builders_plan import partition, settings


def changed(disruption: Disruption) -> Update:
    return Update(
        address=Address(partition="vision"),
        before=partition(settings("vision", processors=2)),
        after=partition(settings("vision", processors=1)),
        reason=Reason(says="its processors differ"),
        disruption=disruption,
    )


@pytest.mark.parametrize(
    ("disruption", "told"),
    [
        (Disruption.LIVE, []),
        (Disruption.PARTITION_STOP, ["partition/vision"]),
        (Disruption.HOST_RESTART, ["partition/vision"]),
    ],
)
def test_a_partition_that_is_stopped_for_a_change_is_told_at_the_address_an_acceptance_names(
    disruption: Disruption, told: list[str]
) -> None:
    assert [restart.address for restart in restarts([changed(disruption)])] == told


def test_the_reason_of_the_change_is_said() -> None:
    (one,) = restarts([changed(Disruption.PARTITION_STOP)])

    assert (one.code, one.detail) == ("RARMS041", '"vision" runs, and it is stopped for this: its processors differ.')


def test_a_removal_is_no_restart() -> None:
    before = partition(settings("vision"))
    removal = Delete(
        address=Address(partition="vision"),
        before=before,
        reason=Reason(says="it is not wanted"),
        disruption=Disruption.REMOVAL,
    )

    assert list(restarts([removal])) == []
