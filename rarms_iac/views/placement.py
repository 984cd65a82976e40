"""What is said of the choice of hosts, by every view alike."""

from fractions import Fraction

from rarms_iac.model.layout import Placement
from rarms_iac.model.quantities import show_processors


def placement_says(placement: Placement) -> str:
    """How good the choice of hosts is, in a sentence."""
    if placement.verdict == "optimal":
        return "The choice of hosts is proved and certified: none reserves less, and none as good moves fewer."
    if placement.verdict == "within the bound":
        apart = show_processors(Fraction(placement.reserved - placement.reserved_bound, 100))
        return (
            f"The choice of hosts is within {apart} and {placement.moves - placement.moves_bound} moves of the bound."
        )
    return f"The choice of hosts is {placement.verdict}."
