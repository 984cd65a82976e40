"""Hosts while partitions are put onto them and taken away again: what is where, and who still has room."""

from collections.abc import Iterable, Mapping, Sequence

from rarms_iac.model.capacity import packs_by_size
from rarms_iac.model.plan import Claim
from rarms_iac.planner.placing.first_fit import Bin, Item, cost, free_in, largest_first

Value = tuple[int, int, int]
"""Partitions without a host, reservation in per cent of one logical processor, moves: the less the better."""


class Park:
    """A placement in the making; every host always keeps what it promises."""

    def __init__(self, items: Sequence[Item], bins: Sequence[Bin]) -> None:
        self.items = {one.name: one for one in items}
        self.bins = {one.name: one for one in bins}
        self.there: dict[str, dict[str, Claim]] = {one.name: {} for one in bins}
        self.where: dict[str, str] = {}
        free = {one.name: free_in(one) for one in bins}
        self.percent = {name: one.percent for name, one in free.items()}
        self.memory = {name: one.memory for name, one in free.items()}
        self.wholes = {name: (max(1, one.percent), max(1, one.memory)) for name, one in free.items()}

    def takes(self, item: Item, host: str, instead: Iterable[str] = ()) -> bool:
        """Whether the host has room for it beside what is there, without those that it comes in the place of."""
        claim = item.claims.get(host)
        if claim is None:
            return False
        there, gone = self.there[host], set(instead)
        percent = self.percent[host] + sum(cost(there[one]) for one in gone) - cost(claim)
        memory = self.memory[host] + sum(there[one].memory for one in gone) - claim.memory
        if percent < 0 or memory < 0:
            return False
        # By first fit, as scripts ask too; the exact packing of virtual processors takes long to say no.
        stay = [one for name, one in there.items() if name not in gone]
        lanes = self.bins[host].capacity.logical_processors
        narrow = not claim.reserve or claim.processors <= lanes
        return narrow and packs_by_size([*self.bins[host].taken, *stay, claim], lanes)

    def put(self, item: Item, host: str) -> None:
        """It is there from now on."""
        claim = item.claims[host]
        self.there[host][item.name] = claim
        self.where[item.name] = host
        self.percent[host] -= cost(claim)
        self.memory[host] -= claim.memory

    def take_away(self, item: Item) -> str:
        """It is nowhere from now on; the host where it was."""
        host = self.where.pop(item.name)
        claim = self.there[host].pop(item.name)
        self.percent[host] += cost(claim)
        self.memory[host] += claim.memory
        return host

    def share(self, item: Item, host: str) -> float:
        """The part of the host that it takes."""
        claim, (percent, memory) = item.claims[host], self.wholes[host]
        return cost(claim) / percent + claim.memory / memory

    def left(self, host: str) -> float:
        """The part of the host that nothing takes."""
        percent, memory = self.wholes[host]
        return self.percent[host] / percent + self.memory[host] / memory

    def best_host(self, item: Item, but: str = "") -> str | None:
        """Where it costs least, then where it is, then where least is left open; None: nowhere is room."""
        ranked = sorted(
            (cost(claim), host != item.now, self.left(host), host)
            for host, claim in item.claims.items()
            if host != but and self.percent[host] >= cost(claim) and self.memory[host] >= claim.memory
        )
        return next((host for *_, host in ranked if self.takes(item, host)), None)

    def waiting(self) -> list[Item]:
        """Those that are nowhere, the largest first."""
        return sorted((one for name, one in self.items.items() if name not in self.where), key=largest_first)

    def value(self) -> Value:
        """How good it is."""
        placed = [(self.items[name], host) for name, host in self.where.items()]
        return (
            len(self.items) - len(placed),
            sum(cost(one.claims[host]) for one, host in placed),
            sum(price(one, host)[1] for one, host in placed),
        )

    def put_all(self, hosts: Mapping[str, str]) -> None:
        """Those that the mapping names change to where it says, all at once."""
        for name in hosts:
            if name in self.where:
                self.take_away(self.items[name])
        for name, host in hosts.items():
            self.put(self.items[name], host)


def price(item: Item, host: str) -> tuple[int, int]:
    """What it costs there, and whether that is a move."""
    return cost(item.claims[host]), int(bool(item.now) and item.now != host)
