"""The problem that the search is given: what checks forbid, beside the same problem without them."""

import pytest

from rarms_iac.model.host import ProviderKind
from rarms_iac.planner.problem import problem_of
from rarms_iac.planner.reservations import FixedReservations
from tests.builders import a_component, a_host, a_system


@pytest.mark.parametrize(
    ("provider", "alike"), [(ProviderKind.SIMULATED, True), (ProviderKind.LINUX, True), (ProviderKind.HYPERV, False)]
)
def test_a_search_without_checks_is_another_only_where_one_bounds_something(
    provider: ProviderKind, alike: bool
) -> None:
    components = [a_component(name, reserve="60 %", memory="64 MiB") for name in ("speech", "vision")]
    problem = problem_of(
        a_system(hosts=[a_host(provider=provider)], components=components), FixedReservations(), {}, may_move=True
    )

    unchecked = problem.without_checks()

    assert ((problem.items, problem.bins) == (unchecked.items, unchecked.bins)) is alike
