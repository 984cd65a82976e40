"""The optimal search tree: which setting to measure first so that the fewest are needed on average."""

from collections.abc import Collection, Sequence
from itertools import accumulate

NOTHING_PASSED = 101
"""As the upper end of a bracket: no setting has passed yet."""

WIDTH = 3
"""A passing setting is certified by a failing one at most so many points below it."""

AGAIN = 0.3
"""Settings to come after an end with points between fail and pass: so often the curve asks for one of those, too."""

_BESIDE = 4  # where a search may end is not quite what Knuth's rule allows


def certain(
    chances: Sequence[float], failed: int, passed: int, doubt: float, closed: Collection[int] = frozenset()
) -> bool:
    """Whether the search may end between a failing setting (0: none) and a passing one (101: none).

    `chances[c]` is the probability that c is the least reservation; that it lies more than a point below `passed` may
    have the probability `doubt`. Those that are closed are not to be measured: where no other is left, it ends.
    """
    if passed == NOTHING_PASSED:
        return failed == NOTHING_PASSED - 1
    if passed - failed - 1 == len(closed):
        return True
    if passed - failed > WIDTH or (failed == 0 and passed > 1):
        return False
    inside = sum(chances[failed + 1 : passed + 1])
    return sum(chances[failed + 1 : passed - 1]) <= doubt * inside


def root(
    chances: Sequence[float], failed: int, passed: int, doubt: float, closed: Collection[int] = frozenset()
) -> int:
    """The setting to measure next, when the answer lies above `failed` and not above `passed`; none that is closed.

    A dynamic program over all brackets: V(l, r) = 0 where the search may end (`AGAIN` P(l, r) with points in between),
    otherwise P(l, r) + the least over m of V(l, m) + V(m, r), with P the probability of the bracket. The best m hardly
    moves left as a bracket's ends move right (Knuth), so that m is looked for between those of the two brackets one
    shorter, and a little beside.
    """
    summed = [0.0, *accumulate(chances)]  # summed[c + 1] - summed[b + 1]: the probability of b < least <= c
    costs: dict[tuple[int, int], float] = {}
    roots: dict[tuple[int, int], int] = {}
    for width in range(1, passed - failed + 1):
        for left in range(failed, passed - width + 1):
            right = left + width
            if _ends(summed, left, right, doubt):
                again = AGAIN if right - left > 1 else 0.0
                costs[left, right], roots[left, right] = again * (summed[right + 1] - summed[left + 1]), left + 1
                continue
            low, high = left + 1, min(right - 1, NOTHING_PASSED - 1)
            if width > 8 and not closed:
                low = max(low, roots[left, right - 1] - _BESIDE)
                high = max(low, min(high, roots[left + 1, right] + _BESIDE))
            open_ones = [m for m in range(low, high + 1) if m not in closed]
            if not open_ones:
                costs[left, right], roots[left, right] = 0.0, low
                continue
            best = min(open_ones, key=lambda m: costs[left, m] + costs[m, right])
            costs[left, right] = summed[right + 1] - summed[left + 1] + costs[left, best] + costs[best, right]
            roots[left, right] = best
    return roots[failed, passed]


def _ends(summed: Sequence[float], left: int, right: int, doubt: float) -> bool:
    """`certain`, from summed chances."""
    if right == NOTHING_PASSED:
        return left == NOTHING_PASSED - 1
    if right - left == 1 and (left > 0 or right == 1):
        return True
    if right - left > WIDTH or left == 0:
        return False
    return summed[right - 1] - summed[left + 1] <= doubt * (summed[right + 1] - summed[left + 1])
