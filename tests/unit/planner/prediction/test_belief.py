"""What is expected: between what is known, wide at first, and as narrow as the predictions have shown to be good."""

from rarms_iac.planner.prediction.belief import Belief, Outlook, belief_of


def outlook(said: float | None, *, failed: int | None = None, passed: int | None = None) -> Outlook:
    low = 40 if failed is None else failed + 1
    return Outlook(neediest=40.0, together=70.0, predictions=(said,), low=low, passed=passed, failed=failed)


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
