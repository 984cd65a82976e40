"""What is said of the choice of hosts, by every view alike."""

from fractions import Fraction

from rarms_iac.model.layout import Placement
from rarms_iac.model.quantities import show_processors


def placement_says(one: Placement) -> str:
    """How good the choice of hosts is, in a sentence."""
    if one.verdict == "optimal":
        return "The choice of hosts is proved and certified: none reserves less, and none as good moves fewer."
    if one.verdict == "within the bound":
        apart = show_processors(Fraction(one.reserved - one.reserved_bound, 100))
        return f"The choice of hosts is within {apart} and {one.moves - one.moves_bound} moves of the bound."
    return f"The choice of hosts is {one.verdict}."
