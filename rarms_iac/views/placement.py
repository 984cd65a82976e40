"""What is said of the choice of hosts, by every view alike."""

from fractions import Fraction

from rarms_iac.model.layout import Placement
from rarms_iac.model.quantities import show_processors


def placement_says(placement: Placement) -> str:
    """How good the choice of hosts is, in a sentence."""
    if placement.verdict == "optimal":
        return "The choice of hosts is optimal: none reserves less, and none as good moves fewer."
    gap = show_processors(Fraction(placement.reserved - placement.reserved_bound, 100))
    return f"The choice of hosts is within {gap} and {placement.moves - placement.moves_bound} moves of the bound."
