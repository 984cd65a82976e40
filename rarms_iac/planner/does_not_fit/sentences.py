"""What is said of partitions that find no room together."""

from collections.abc import Callable, Sequence
from fractions import Fraction

from rarms_iac.model.quantities import show_bytes, show_percent, show_processors
from rarms_iac.model.wording import in_a_row, number
from rarms_iac.planner.placing.first_fit import Bin, Item, cost, free_in

LISTED_UP_TO = 12
"""Names in a sentence; more are counted."""


def processors_exceed(chosen: Sequence[Item], bins: Sequence[Bin]) -> str:
    """Say it as in: FDP 70 %, SRP 30 % and PPP 20 % need 120 % of the two logical processors."""
    ordered = sorted(chosen, key=lambda one: (-min(cost(c) for c in one.claims.values()), one.name))
    taken = sum(cost(claim) for one in bins for claim in one.taken)
    if len(bins) == 1:
        host = bins[0]
        whole = host.capacity.logical_processors

        def share(percent: int | Fraction) -> str:
            return show_percent(Fraction(percent) / whole)

        kept = 100 * (whole - host.capacity.processors)
        parts = [f"{one.name} {share(cost(one.claims[host.name]))}" for one in ordered]
        total = share(sum(cost(one.claims[host.name]) for one in ordered))
        return (
            f"{_listed(parts)} {_verb(parts)} {total} of the {_processors(host)}"
            f"{_less([(kept, 'kept for the host'), (taken, 'taken by machines that are not ours')], share)}."
        )
    parts = [
        f"{one.name} {show_processors(Fraction(min(cost(c) for c in one.claims.values()), 100))}" for one in ordered
    ]
    total = show_processors(sum(Fraction(min(cost(c) for c in one.claims.values()), 100) for one in ordered))
    free = show_processors(Fraction(sum(max(0, free_in(one).percent) for one in bins), 100))
    return f"{_listed(parts)} {_verb(parts)} {total}; {_listed([one.name for one in bins])} have {free} to promise."


def memory_exceeds(chosen: Sequence[Item], bins: Sequence[Bin]) -> str:
    """Say it as in: FDP 3 GiB and SRP 2 GiB need 5 GiB; onboard has 4 GiB to promise."""
    ordered = sorted(chosen, key=lambda one: (-min(c.memory for c in one.claims.values()), one.name))
    parts = [f"{one.name} {show_bytes(min(c.memory for c in one.claims.values()))}" for one in ordered]
    total = show_bytes(sum(min(c.memory for c in one.claims.values()) for one in ordered))
    free = show_bytes(sum(max(0, free_in(one).memory) for one in bins))
    have = "has" if len(bins) == 1 else "have"
    return f"{_listed(parts)} {_verb(parts)} {total}; {_listed([one.name for one in bins])} {have} {free} to promise."


def find_no_room(chosen: Sequence[Item], bins: Sequence[Bin]) -> str:
    """Where the sums would fit: on one host it is its virtual processors, on several each host by itself."""
    names = _listed([one.name for one in chosen])
    if len(bins) == 1:
        return (
            f"The virtual processors of {names} find no room on the {_processors(bins[0])}, though their sum would: "
            f"each needs its whole reserve on one of them."
        )
    return f"{names} find no room together on {_listed([one.name for one in bins])}, host by host."


def _less(amounts: Sequence[tuple[int | Fraction, str]], share: Callable[[int | Fraction], str]) -> str:
    words = [f"{share(amount)} {what}" for amount, what in amounts if amount]
    return f", of which {_listed(words)} are not to be had" if words else ""


def _verb(parts: Sequence[str]) -> str:
    return "needs" if len(parts) == 1 else "need"


def _processors(host: Bin) -> str:
    many = host.capacity.logical_processors
    return f"{number(many)} logical processor{'' if many == 1 else 's'}"


def _listed(words: Sequence[str]) -> str:
    if len(words) > LISTED_UP_TO:
        return f"{', '.join(words[:LISTED_UP_TO])} and {len(words) - LISTED_UP_TO} others"
    return in_a_row(words)
