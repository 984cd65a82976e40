"""What is expected: between what is known, wide at first, and as narrow as the predictions have shown to be good."""

import random

import pytest

from rarms_iac.planner.prediction.belief import Belief, Outlook, belief_of


def outlook(said: float | None, *, failed: int | None = None, passed: int | None = None) -> Outlook:
    low = 40 if failed is None else failed + 1
    return Outlook(neediest=40.0, together=70.0, said=(said,), low=low, passed=passed, failed=failed)


def width(belief: Belief, said: float) -> int:
    expected = belief.of(outlook(said))
    return expected.quantile(0.9) - expected.quantile(0.1)


def test_what_foretold_well_is_believed() -> None:
    good = [outlook(said, failed=int(said) - 1, passed=int(said) + 1) for said in (45.0, 51.0, 57.0, 62.0)]
    before, after = belief_of(1, []), belief_of(1, good)

    assert width(after, 50.0) <= 5 < width(before, 50.0)
    assert abs(after.of(outlook(50.0)).quantile(0.5) - 50) <= 1


def test_what_foretold_badly_is_not() -> None:
    bad = [outlook(said, failed=truth - 1, passed=truth) for said, truth in ((45.0, 66), (65.0, 42), (44.0, 60))]

    assert width(belief_of(1, bad), 50.0) > 15


def test_a_bias_is_learnt() -> None:
    over = [outlook(said, failed=int(said) - 7, passed=int(said) - 6) for said in (50.0, 53.0, 58.0, 61.0, 65.0)]

    assert abs(belief_of(1, over).of(outlook(60.0)).quantile(0.5) - 54) <= 2


@pytest.mark.parametrize("said", [45.0, 90.0, None])
def test_nothing_is_expected_outside_of_what_is_known(said: float | None) -> None:
    belief = belief_of(1, [])
    one = outlook(said, failed=49, passed=55)
    expected = belief.of(one)

    assert (expected.below(49), expected.below(55)) == (0.0, 1.0)
    assert [expected.below(at) for at in range(49, 56)] == sorted(expected.below(at) for at in range(49, 56))
    drawn = [belief.drawn(at / 20).need(one, random.Random(at).random()) for at in range(20)]
    assert min(drawn) >= 50
    assert max(drawn) <= 55


def test_what_is_drawn_is_as_likely_as_the_belief_says() -> None:
    chance, belief, one = random.Random(1), belief_of(1, []), outlook(50.0)
    drawn = [belief.drawn(chance.random()).need(one, chance.random()) for _ in range(2000)]

    for reserve in (42, 50, 58, 66):
        part = sum(each <= reserve for each in drawn) / len(drawn)
        assert abs(part - belief.of(one).below(reserve)) < 0.05
