"""How the settings of an experiment are chosen: a search, a sweep, a verification or a question about one setting."""

from dataclasses import dataclass
from typing import assert_never

from rarms_iac.measuring.loop import Strategy
from rarms_iac.measuring.search import STRATEGIES
from rarms_iac.measuring.search.trials import Goal
from rarms_iac.measuring.strategies import Agreeing, Searching, Sweep, ThresholdCheck, Verifying

PAPER = "paper"
"""The name of the paper's procedures, which know nothing of reservations beside P1's and P2's."""

USUAL_STEP = 10
"""Per cent between settings of the performance measurement mode, and the first of them."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Search:
    """The least reservation that meets every threshold is searched."""

    strategy: str = "default"  # a name in `STRATEGIES`


@dataclass(frozen=True, slots=True, kw_only=True)
class Verification:
    """The reservation that the curve gives between two settings is measured."""


Method = Search | Sweep | Verification | ThresholdCheck


def is_of_paper(method: Method) -> bool:
    """Tell whether the paper's procedure is followed to the letter, by a search or by what tuning asks."""
    return isinstance(method, Search | ThresholdCheck) and method.strategy == PAPER


def reserves_of(method: Sweep, most: int) -> tuple[int, ...]:
    """Return the settings of a sweep; of a coarse one 10, 20, ... as far as the host can give them.

    Args:
        method: The sweep.
        most: The highest CR that the host can give, in per cent; 0: none, and the first setting says so.

    Returns:
        Whole per cent, ascending, each once; of a coarse sweep the highest that the host can give is among them.
    """
    return method.reserves or tuple(dict.fromkeys((*range(USUAL_STEP, most + 1, USUAL_STEP), most or USUAL_STEP)))


def strategy_of(method: Method, goal: Goal, most: int) -> Strategy:
    """Return the strategy that the loop of measuring asks for each next setting.

    Args:
        method: How settings are chosen.
        goal: What is measured; for a search or a verification each of its members has a threshold.
        most: The highest CR that the host can give, in per cent.
    """
    match method:
        case Sweep():
            return Sweep(reserves=reserves_of(method, most))
        case ThresholdCheck():
            return method
        case Verification():
            return Verifying(goal=goal, most=most)
        case Search(strategy=name):
            search = Searching(goal=goal, next_step=STRATEGIES[name], most=most, own_settings_only=name == PAPER)
            return search if name == PAPER else Agreeing(search=search, verifying=Verifying(goal=goal, most=most))
        case _:
            assert_never(method)
