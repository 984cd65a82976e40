"""Items by what they are worth for what they take: the order in which filling up in parts is a bound."""

from collections.abc import Iterable, Mapping, Sequence


def by_worth(items: Iterable[int], profits: Sequence[int], takes: Mapping[int, int] | Sequence[int]) -> list[int]:
    """The most profit for its size first, ties by number: exactly, since in any other order the bound is none.

    Two ratios of sizes below 2^b lie at least 2^-2b apart, so whole parts of so fine a grain tell them apart. Who takes
    nothing comes first, or last where it brings nothing.
    """
    some = list(items)
    grain = 2 * max((takes[one] for one in some), default=0).bit_length()

    def key(one: int) -> tuple[int, int, int]:
        if not takes[one]:
            return (0 if profits[one] > 0 else 2), 0, one
        return 1, -((profits[one] << grain) // takes[one]), one

    return sorted(some, key=key)
