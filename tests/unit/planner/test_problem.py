"""The problem that the search is given: what checks forbid, beside the same problem without them."""

from collections.abc import Sequence

import pytest

from rarms_iac.model.host import ProviderKind
from rarms_iac.model.layout import Infeasible
from rarms_iac.planner import problem as searched
from rarms_iac.planner.packing.pack import pack
from rarms_iac.planner.packing.values import Bin, Item, NoPacking, Packing
from rarms_iac.planner.problem import problem_of, solve
from rarms_iac.planner.reservations import FixedReservations
from tests.builders import a_component, a_host, a_system


@pytest.mark.parametrize(
    ("provider", "alike"), [(ProviderKind.SIMULATED, True), (ProviderKind.LINUX, True), (ProviderKind.HYPERV, False)]
)
def test_unchecked_search_differs_only_with_bounds(provider: ProviderKind, alike: bool) -> None:
    components = [a_component(name, reserve="60 %", memory="64 MiB") for name in ("speech", "vision")]
    problem = problem_of(
        a_system(hosts=[a_host(provider=provider)], components=components), FixedReservations(), {}, may_move=True
    )

    unchecked = problem.without_checks()

    assert ((problem.items, problem.bins) == (unchecked.items, unchecked.bins)) is alike


@pytest.mark.parametrize("provider", list(ProviderKind))
def test_certain_misfit_is_searched_once(provider: ProviderKind, monkeypatch: pytest.MonkeyPatch) -> None:
    components = [a_component(name, reserve="80 %", memory="64 MiB") for name in ("speech", "vision")]
    problem = problem_of(
        a_system(hosts=[a_host(provider=provider)], components=components), FixedReservations(), {}, may_move=True
    )
    searches: list[object] = []

    def counted(items: Sequence[Item], bins: Sequence[Bin]) -> Packing | NoPacking:
        searches.append(bins)
        return pack(items, bins)

    monkeypatch.setattr(searched, "pack", counted)

    answer = solve(problem)

    assert isinstance(answer, Infeasible)
    assert answer.proven
    assert len(searches) == 1
