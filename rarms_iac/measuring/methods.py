"""How the settings of an experiment are chosen: a search, a sweep or a question about one setting."""

from dataclasses import dataclass, replace
from typing import assert_never

from rarms_iac.measuring.search import STRATEGIES
from rarms_iac.measuring.search.trials import Goal
from rarms_iac.measuring.strategies import Checking, Confirming, Searching, Strategy, Sweep, ThresholdCheck

PAPER = "paper"
"""The name of the paper's procedures in `STRATEGIES`. They assume that only P1 and P2 reserve anything."""

USUAL_STEP = 10
"""Per cent between settings of the performance measurement mode, and the first of them."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Search:
    """Search the least reservation that meets every threshold."""

    strategy: str = "default"  # a name in `STRATEGIES`
    floor: int = 0  # per cent that loads before this one ask for: less is no answer; 0: this is the first load


Method = Search | Sweep | ThresholdCheck


def is_of_paper(method: Method) -> bool:
    """Tell whether a search, or a question of tuning, follows the paper's procedure to the letter."""
    return isinstance(method, Search | ThresholdCheck) and method.strategy == PAPER


def reserves_of(method: Sweep, most: int) -> tuple[int, ...]:
    """Return the settings of a sweep; without settings of its own 10, 20, ... up to the highest that the host can give.

    Args:
        most: The highest CR that the host can give, in per cent; 0: none, and the first setting is refused.

    Returns:
        Whole per cent, ascending, each once. A sweep without settings of its own ends with `most`.
    """
    return method.reserves or tuple(dict.fromkeys((*range(USUAL_STEP, most + 1, USUAL_STEP), most or USUAL_STEP)))


def strategy_of(method: Method, goal: Goal, most: int) -> Strategy:
    """Return the strategy that `loop.measure_settings` asks for each next setting.

    Args:
        goal: What is measured; for a search each of its members has a threshold.
        most: The highest CR that the host can give, in per cent.
    """
    match method:
        case Sweep():
            return Sweep(reserves=reserves_of(method, most))
        case ThresholdCheck(reserve=reserve):
            return Checking(goal=replace(goal, ends_at_until=is_of_paper(method)), reserve=reserve)
        case Search(strategy=name, floor=floor):
            goal = replace(goal, ends_at_until=name == PAPER)
            search = Searching(goal=goal, decide_search=STRATEGIES[name], most=most)
            return Confirming(goal=goal, floor=floor, search=search) if floor else search
        case _:
            assert_never(method)
