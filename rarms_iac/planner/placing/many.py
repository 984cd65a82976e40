"""Many partitions onto hosts: several ways to begin, then better by moves, exchanges and parts that are packed anew."""

from collections.abc import Callable, Iterator, Mapping, Sequence
from random import Random

from rarms_iac.planner.packing.plain.large import pack_many
from rarms_iac.planner.placing.first_fit import Bin, Item, all_fit, cost, free_in, largest_first
from rarms_iac.planner.placing.park import Park, Value, price

Repack = Callable[[Sequence[Item], Sequence[Bin]], Mapping[str, str] | None]
"""Packs a few partitions onto a few hosts as well as it can; None where it finds no way."""

_TURNS = 4_000
"""How often a partition may take the place of a smaller one."""

_ANEW = 30
"""Parts that are packed anew, at most, and partitions of one."""

_ITEMS = 28
_HOSTS = 4

_ROUNDS = 20


def place_many(
    items: Sequence[Item], bins: Sequence[Bin], stay: Sequence[str], target: tuple[int, int], repack: Repack
) -> dict[str, str] | None:
    """The best placement that is found, None where none is.

    Args:
        items: the partitions.
        bins: the hosts.
        stay: partitions that can all stay where they are.
        target: reservation and moves that no placement is below; reaching it ends the search.
        repack: an exact packing of parts.
    """
    best: Park | None = None
    for park in _beginnings(items, bins, stay):
        _seat(park)
        if park.waiting():
            _pack_parts(park, repack, _crowded)
        improve(park)
        if best is None or park.value() < best.value():
            best = park
        if park.value() <= (0, *target):
            break
        if not park.waiting() and park.value()[2] == target[1]:
            break
    if best is not None and not best.waiting() and best.value() > (0, *target):
        _pack_parts(best, repack, _moved)
        improve(best)
    return None if best is None or best.waiting() else dict(best.where)


def _beginnings(items: Sequence[Item], bins: Sequence[Bin], stay: Sequence[str]) -> Iterator[Park]:
    """What can stay stays; nothing does, in two orders; and hosts that are alike, as equal bins."""
    at_home = set(stay)
    park = Park(items, bins)
    for one in items:
        if one.name in at_home and park.takes(one, one.now):
            park.put(one, one.now)
    yield park
    yield Park(items, bins)
    alike = _as_equal_bins(items, bins)
    if alike is not None:
        park = Park(items, bins)
        park.put_all(alike)
        yield park
    shares = Park(items, bins)
    for one in sorted(items, key=lambda one: (-max(shares.share(one, host) for host in one.claims), one.name)):
        host = shares.best_host(one)
        if host is not None:
            shares.put(one, host)
    yield shares


def _seat(park: Park) -> None:
    """Everyone that waits onto a host, the largest first; where none has room, in the place of a smaller one."""
    random = Random(len(park.items))  # noqa: S311 - the same input gives the same turns
    waiting = park.waiting()[::-1]
    turns = _TURNS
    while waiting and turns > 0:
        item = waiting.pop()
        host = park.best_host(item)
        if host is not None:
            park.put(item, host)
            continue
        turns -= 1
        gone = _turned_out(park, item, random)
        if gone is None:
            continue
        waiting = sorted([*waiting, gone], key=largest_first, reverse=True)


def _turned_out(park: Park, item: Item, random: Random) -> Item | None:
    """The smallest that makes room for the item is turned out, one that finds another host before others."""
    ways = []
    for host in item.claims:
        for name in park.there[host]:
            other = park.items[name]
            if park.share(other, host) < park.share(item, host) and park.takes(item, host, (name,)):
                elsewhere = park.best_host(other, but=host) is not None
                ways.append((not elsewhere, park.share(other, host) * (1 + random.random()), name, host))
    if not ways:
        return None
    *_, name, host = min(ways)
    gone = park.items[name]
    park.take_away(gone)
    park.put(item, host)
    return gone


def improve(park: Park) -> None:
    """Move and exchange partitions while the reservation, or then the moves, fall."""
    for _ in range(_ROUNDS):
        if not sum(_better_place(park, item) for item in sorted(park.items.values(), key=largest_first)):
            return


def _better_place(park: Park, item: Item) -> bool:
    """Whether the item found a better host, by itself or in exchange."""
    here = park.where.get(item.name)
    if here is None:
        return False
    own = price(item, here)
    better = sorted((price(item, host), host) for host in item.claims if host != here and price(item, host) < own)
    for new, host in better:
        if park.takes(item, host):
            park.take_away(item)
            park.put(item, host)
            return True
        for name in list(park.there[host]):
            other = park.items[name]
            if here not in other.claims:
                continue
            before = tuple(map(sum, zip(own, price(other, host), strict=True)))
            after = tuple(map(sum, zip(new, price(other, here), strict=True)))
            if after < before and park.takes(item, host, (name,)) and park.takes(other, here, (item.name,)):
                park.put_all({item.name: host, name: here})
                return True
    return False


Choose = Callable[[Park, Random], tuple[list[Item], list[str]] | None]
"""Partitions without a host that are to find one, and hosts that are packed anew with them."""


def _pack_parts(park: Park, repack: Repack, choose: Choose) -> None:
    """Pack a few hosts anew at a time, exactly, where that is better."""
    random = Random(len(park.items))  # noqa: S311 - the same input gives the same parts
    for _ in range(_ANEW):
        chosen = choose(park, random)
        if chosen is None:
            return
        outside, hosts = chosen
        inside = [park.items[name] for host in hosts for name in park.there[host]]
        part = sorted([*outside, *inside], key=lambda one: one.name)
        claims = [one for one in part if any(host in one.claims for host in hosts)]
        if len(claims) < len(part):
            continue
        found = repack(part, [park.bins[host] for host in hosts])
        if found is not None:
            _take_if_better(park, found)


def _take_if_better(park: Park, found: Mapping[str, str]) -> None:
    before: Value = park.value()
    was = {name: park.where[name] for name in found if name in park.where}
    park.put_all(found)
    if park.value() >= before:
        for name in found:
            park.take_away(park.items[name])
        for name, host in was.items():
            park.put(park.items[name], host)


def _crowded(park: Park, random: Random) -> tuple[list[Item], list[str]] | None:
    """One that waits, and hosts that it may run on and that have most left, shaken."""
    waiting = park.waiting()
    if not waiting:
        return None
    item = waiting[random.randrange(len(waiting))]
    ranked = sorted(item.claims, key=lambda host: (-park.left(host) * (0.5 + random.random()), host))
    return [item], _few(park, ranked, 1)


def _moved(park: Park, random: Random) -> tuple[list[Item], list[str]] | None:
    """One that is not where it would cost least or be at home: its host, the better one, and some more."""
    better = [
        (item, host, there)
        for item in park.items.values()
        for host in [park.where[item.name]]
        for there in [min(item.claims, key=lambda name: (price(item, name), name))]
        if price(item, there) < price(item, host)
    ]
    if not better:
        return None
    _, host, there = better[random.randrange(len(better))]
    rest = [one for one in sorted(park.bins) if one not in (host, there)]
    random.shuffle(rest)
    return [], _few(park, [host, there, *rest], 0)


def _few(park: Park, ranked: Sequence[str], outside: int) -> list[str]:
    """As many of the hosts as an exact search takes on."""
    chosen, items = list[str](), outside
    for host in ranked:
        items += len(park.there[host])
        if len(chosen) == _HOSTS or items > _ITEMS:
            break
        chosen.append(host)
    return chosen


def _as_equal_bins(items: Sequence[Item], bins: Sequence[Bin]) -> dict[str, str] | None:
    """A placement where all hosts are alike, and so is what everyone claims of them."""
    free = free_in(bins[0])
    names = {one.name for one in bins}
    first = [one.claims.get(bins[0].name) for one in items]
    same = all((one.capacity, one.taken) == (bins[0].capacity, bins[0].taken) for one in bins) and all(
        claim is not None and set(one.claims) == names and len(set(one.claims.values())) == 1
        for one, claim in zip(items, first, strict=True)
    )
    if not same or min(free.percent, free.memory) <= 0:
        return None
    sizes = [(cost(claim), claim.memory) for claim in first if claim is not None]
    if any(size[0] > free.percent or size[1] > free.memory for size in sizes):
        return None
    packed = pack_many(sizes, (free.percent, free.memory), len(bins))
    if packed.used > len(bins):
        return None
    home = _homes(items, packed.bins, [one.name for one in bins])
    placed = {item.name: home[bin_] for item, bin_ in zip(items, packed.bins, strict=True)}
    return placed if all_fit(items, bins, placed) else None


def _homes(items: Sequence[Item], numbers: Sequence[int], hosts: Sequence[str]) -> dict[int, str]:
    """By bin: the host where most of what is in it runs now."""
    counts: dict[tuple[int, str], int] = {}
    for item, bin_ in zip(items, numbers, strict=True):
        counts[bin_, item.now] = counts.get((bin_, item.now), 0) + 1
    wishes = sorted((-counts.get((bin_, host), 0), bin_, host) for bin_ in set(numbers) for host in hosts)
    home: dict[int, str] = {}
    taken: set[str] = set()
    for _, bin_, host in wishes:
        if bin_ not in home and host not in taken:
            home[bin_] = host
            taken.add(host)
    return home
