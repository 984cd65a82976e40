"""What can be lowered of a partition, step by step: a reserve that is fixed, or an APT whose curve reaches lower."""

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from functools import partial
from math import ceil

from rarms_iac.model.quantities import CpuAmount, ProcessorTime
from rarms_iac.model.system import Measured, System
from rarms_iac.planner.does_not_fit.relaxed_apts import Slack, slack_of
from rarms_iac.planner.does_not_fit.variants import (
    Edit,
    Edits,
    Trial,
    amount_like,
    component_reserves,
    flat,
    partition_reserves,
    relaxed,
)
from rarms_iac.planner.groups import Group
from rarms_iac.planner.problem import Problem

READ_UP_TO = 8
"""Changes that are told together: nobody makes more of them from a list."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Lever:
    """Steps below what is now, the lowest first; the lower, the sooner everything fits."""

    partition: str
    levels: Sequence[int]
    at: Callable[[int], Edits]


def reserves_of(group: Group) -> Iterator[Lever]:
    """The reserves that the manifest fixes for a partition: its own, or its members', the least critical first."""
    own = group.wish.cpu.reserve
    if own is not None and not isinstance(own, Measured):
        yield _lowered(group, own, partial(partition_reserves, group.name, own))
        return
    for component in reversed(group.members):
        reserve = component.cpu.reserve
        if reserve is not None and not isinstance(reserve, Measured):
            yield _lowered(group, reserve, partial(component_reserves, component))


def _lowered(group: Group, before: CpuAmount, edit: Callable[[CpuAmount], Edit]) -> Lever:
    steps = 100 * before.processors if isinstance(before, ProcessorTime) else before.percent

    def at(level: int) -> Edits:
        return (edit(amount_like(before, level)),)

    return Lever(partition=group.name, levels=range(1, ceil(steps)), at=at)


def apts_of(group: Group, problem: Problem) -> Iterator[Lever]:
    """The APTs of a partition together, as its curves let them be relaxed; none where its reserve is fixed."""
    claims = problem.claims[group.name]
    slack = slack_of(group, problem.system.hosts[next(iter(claims))], problem.reservations) if claims else None
    if slack is not None:
        yield _of_slack(slack, problem.system)


def _of_slack(slack: Slack, system: System) -> Lever:
    def at(level: int) -> Edits:
        return tuple(relaxed(system, apt, threshold) for apt, threshold in (slack.at(level) or {}).items())

    levels = [one for one in range(slack.lowest, slack.least) if slack.at(one)]
    return Lever(partition=slack.group.name, levels=levels, at=at)


def one_lowered(lever: Lever, trial: Trial) -> Edits | None:
    """As little as helps; None: nothing that it can be lowered by is enough."""
    number = largest(len(lever.levels), lambda at: trial.fits(lever.at(lever.levels[at])))
    return None if number is None else lever.at(lever.levels[number])


def several_lowered(levers: Sequence[Lever], trial: Trial) -> Edits | None:
    """Several together, the least critical first, none without need and each as little as helps.

    None: all of them together are not enough, or more are needed than are read.
    """
    can = [one for one in levers if one.levels]
    chosen: list[Edits] = [one.at(one.levels[0]) for one in can]
    kept = largest(len(can), lambda fewer: trial.fits(flat(chosen[: len(can) - fewer])))
    if kept is None:
        return None
    del chosen[len(can) - kept :]
    for at in reversed(range(len(chosen))):
        rest = trial.after(flat(chosen[:at] + chosen[at + 1 :]))
        chosen[at] = () if rest.fits(()) else one_lowered(can[at], rest) or chosen[at]
    edits = flat(chosen)
    return edits if 0 < len(edits) <= READ_UP_TO else None


def largest(number: int, works: Callable[[int], bool]) -> int | None:
    """The largest of 0, 1, ... below `number` that works, where every smaller one does too; None: 0 does not."""
    if not number or not works(0):
        return None
    low, high = 0, number - 1
    while low < high:
        middle = (low + high + 1) // 2
        low, high = (middle, high) if works(middle) else (low, middle - 1)
    return low
