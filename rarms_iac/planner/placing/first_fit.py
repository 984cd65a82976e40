"""A quick placement of many partitions: the largest first, each where it is or costs least and has room."""

from collections.abc import Mapping, Sequence

from rarms_iac.model.capacity import WHOLE, Load, fits, holds
from rarms_iac.model.plan import Claim
from rarms_iac.planner.assigning.values import Bin as Bin  # noqa: PLC0414  # until the old packing goes
from rarms_iac.planner.assigning.values import Item as Item  # noqa: PLC0414  # until the old packing goes
from rarms_iac.planner.assigning.values import cost as cost  # noqa: PLC0414  # until the old packing goes
from rarms_iac.planner.assigning.values import free_in as free_in  # noqa: PLC0414  # until the old packing goes


def all_fit(items: Sequence[Item], bins: Sequence[Bin], hosts: Mapping[str, str]) -> bool:
    """Whether every host that is used can keep all that is promised there; no where that is not known."""
    return all_hold(items, bins, hosts) is True


def all_hold(items: Sequence[Item], bins: Sequence[Bin], hosts: Mapping[str, str]) -> bool | None:
    """The same; None: of some host it is not known, and of none that it cannot."""
    there: dict[str, list[Claim]] = {one.name: list(one.taken) for one in bins}
    for item in items:
        there[hosts[item.name]].append(item.claims[hosts[item.name]])
    used = set(hosts.values())
    unknown = False
    for one in bins:
        held = holds(one.capacity, there[one.name]) if one.name in used else True
        if held is False:
            return False
        unknown = unknown or held is None
    return None if unknown else True


def first_fit(items: Sequence[Item], bins: Sequence[Bin]) -> dict[str, str] | None:
    """A placement, None where none was found; whoever orders the steps packs anew and finds the same room."""
    quick = _first_fit(items, bins, _Room)
    if quick is not None and not all_fit(items, bins, quick):
        return _first_fit(items, bins, _SureRoom)
    return quick


def _first_fit(items: Sequence[Item], bins: Sequence[Bin], make_room: "type[_Room]") -> dict[str, str] | None:
    """Largest first, each where it is or costs least and has room; every virtual processor gets its place at once."""
    rooms = {one.name: make_room(one) for one in bins}
    hosts: dict[str, str] = {}
    for item in sorted(items, key=largest_first):
        for name in _preferred(item):
            if rooms[name].take(item.claims[name]):
                hosts[item.name] = name
                break
        else:
            return None
    return hosts


class _Room:
    """What is left of a host while partitions are put onto it; what was placed is not moved any more."""

    def __init__(self, one: Bin) -> None:
        self.left = free_in(one)
        self.lanes = [WHOLE] * one.capacity.logical_processors
        for claim in sorted(one.taken, key=lambda taken: -taken.reserve):
            self._lay(claim)

    def take(self, claim: Claim) -> bool:
        """Whether it has room for the claim, which then is taken."""
        left = Load(percent=self.left.percent - cost(claim), memory=self.left.memory - claim.memory)
        if left.percent < 0 or left.memory < 0 or not self._lay(claim):
            return False
        self.left = left
        return True

    def _lay(self, claim: Claim) -> bool:
        """Each virtual processor onto the first logical one that has so much left, on different ones first."""
        if not claim.reserve:
            return True
        if claim.processors > len(self.lanes):
            return False
        lanes = list(self.lanes)
        waiting = claim.processors
        while waiting:
            chosen = [at for at, free in enumerate(lanes) if free >= claim.reserve][:waiting]
            if not chosen:
                return False
            for at in chosen:
                lanes[at] -= claim.reserve
            waiting -= len(chosen)
        self.lanes = lanes
        return True


class _SureRoom(_Room):
    """Takes only what `fits` finds a place for too, so that whoever asks again gets the same answer."""

    def __init__(self, one: Bin) -> None:
        super().__init__(one)
        self.capacity = one.capacity
        self.claims = list(one.taken)
        self.refused: set[Claim] = set()

    def take(self, claim: Claim) -> bool:
        if claim in self.refused:
            return False
        left, lanes = self.left, self.lanes
        if not super().take(claim):
            return False
        if fits(self.capacity, (*self.claims, claim)):
            self.claims.append(claim)
            return True
        self.left, self.lanes = left, lanes
        self.refused.add(claim)
        return False


def largest_first(item: Item) -> tuple[int, int, str]:
    """Sorts by reservation, then memory, then name."""
    return (
        -max(cost(claim) for claim in item.claims.values()),
        -max(claim.memory for claim in item.claims.values()),
        item.name,
    )


def _preferred(item: Item) -> list[str]:
    return sorted(item.claims, key=lambda name: (cost(item.claims[name]), name != item.now, name))
