"""Moves of names: a mark must never stand on two machines, so names are passed on from the free end."""

from collections.abc import Sequence
from dataclasses import replace

from rarms_iac.diff.stepping.partitions import moved
from rarms_iac.diff.stepping.steps import Planned
from rarms_iac.model.changes import Update
from rarms_iac.model.moves import BETWEEN
from rarms_iac.model.operations import WriteMark
from rarms_iac.model.plan import Step
from rarms_iac.model.state import Partition


def old_name(planned: Planned) -> str:
    """The name that the change's partition gives up; empty where it keeps its name."""
    match planned.change:
        case Update(before=Partition(mark=mark)) if mark and mark.name != planned.change.address.partition:
            return mark.name
        case _:
            return ""


def mark_moves(planned: Sequence[Planned]) -> tuple[tuple[Step, ...], tuple[Planned, ...]]:
    """The steps that pass names on, in an order in which each is free when it is taken; and what is left to do.

    Partitions that exchange names: the first by name steps aside, under a name that no manifest can give.
    """
    moving = {name: one for one in planned if (name := old_name(one)) and _starts_with_mark(one)}
    steps: list[Step] = []
    waiting = dict(sorted(moving.items()))
    aside: dict[str, Planned] = {}
    while waiting:
        free = [name for name, one in waiting.items() if one.change.address.partition not in waiting]
        for name in free:
            one = waiting.pop(name)
            steps += _passed(one, aside=name in aside)
        if not free:
            first = min(name for name in waiting)
            one = waiting.pop(first)
            aside[first + BETWEEN] = one
            steps += _aside(one)
            waiting[first + BETWEEN] = one
    started = {id(one) for one in moving.values()}
    rest = tuple(replace(one, steps=one.steps[1:]) if id(one) in started else one for one in planned)
    return tuple(steps), rest


def _starts_with_mark(planned: Planned) -> bool:
    return bool(planned.steps) and isinstance(planned.steps[0].operation, WriteMark)


def _passed(planned: Planned, *, aside: bool) -> list[Step]:
    if not aside:
        return [planned.steps[0]]
    before = _partition(planned)
    assert before.mark is not None
    between = replace(before, mark=replace(before.mark, name=planned.change.address.partition + BETWEEN))
    return list(moved(planned.change.address, between, planned.change.reason))


def _aside(planned: Planned) -> list[Step]:
    name = planned.change.address.partition
    return list(moved(planned.change.address, _partition(planned), planned.change.reason, between=name + BETWEEN))


def _partition(planned: Planned) -> Partition:
    assert isinstance(planned.change, Update)
    assert isinstance(planned.change.before, Partition)
    return planned.change.before
