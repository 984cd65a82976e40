"""The optimal search tree, against what can be worked out by hand and by trying every tree."""

from functools import lru_cache

import pytest

from rarms_iac.measuring.search.default import certain, root
from rarms_iac.measuring.search.trials import NOTHING_PASSED


def even(failed: int, passed: int) -> list[float]:
    """Each reservation of a bracket as probable as the next."""
    return [1.0 / (passed - failed) if failed < reserve <= passed else 0.0 for reserve in range(NOTHING_PASSED + 1)]


def test_what_is_certain_is_measured_and_then_certified() -> None:
    sure = [1.0 if reserve == 40 else 0.0 for reserve in range(NOTHING_PASSED + 1)]

    first = root(sure, 0, NOTHING_PASSED, 0.02)

    assert first in {37, 38, 39, 40, 41}
    assert certain(sure, 37, 40, 0.02)
    assert not certain(sure, 36, 40, 0.02)
    assert not certain(sure, 38, 41, 0.02) or sum(sure[39:40]) <= 0.02


def test_a_pass_without_a_fail_below_is_not_certified_unless_it_is_one_per_cent() -> None:
    assert not certain(even(0, 2), 0, 2, 1.0)
    assert certain(even(0, 1), 0, 1, 0.0)


@pytest.mark.parametrize("passed", [8, 15, 24])
def test_its_cost_on_even_chances_is_the_least_of_all_trees(passed: int) -> None:
    chances = even(4, passed)

    @lru_cache
    def cost(left: int, right: int, best: bool) -> float:
        if certain(chances, left, right, 0.02):
            return 0.0
        inside = sum(chances[left + 1 : right + 1])
        if not best:
            middle = root(chances, left, right, 0.02)
            return inside + cost(left, middle, False) + cost(middle, right, False)
        return inside + min(cost(left, m, True) + cost(m, right, True) for m in range(left + 1, right))

    assert cost(4, passed, False) == pytest.approx(cost(4, passed, True), abs=0.05)


@pytest.mark.parametrize("closed", [{30}, {20, 21, 22, 23}, set(range(6, 39))])
def test_what_is_closed_is_never_the_next(closed: set[int]) -> None:
    for passed in (40, NOTHING_PASSED):
        chosen = root(even(4, passed), 4, passed, 0.02, closed)

        assert chosen not in closed
        assert 4 < chosen < passed


def test_a_bracket_with_nothing_left_to_measure_is_at_its_end() -> None:
    assert certain(even(40, 46), 40, 46, 0.02, {41, 42, 43, 44, 45})
    assert not certain(even(40, 46), 40, 46, 0.02, {42, 43, 44, 45})
    assert root(even(40, 46), 40, 46, 0.02, {42, 43, 44, 45}) == 41
    assert certain(even(0, 3), 0, 3, 0.02, {1, 2})
