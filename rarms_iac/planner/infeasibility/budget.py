"""How much is searched to explain why a manifest does not fit: a count of solver nodes, never a time."""

from collections.abc import Iterable
from dataclasses import dataclass, field

from rarms_iac.planner.packing.highs import Nodes

NODES_FOR_A_CONFLICT = 50
"""Solver nodes in which a smallest conflict is searched for."""

NODES_FOR_MOVES = 50
"""The same for the fewest partitions that have to move."""

NODES_FOR_CHANGES = 100
"""The same for changes of the manifest, of all kinds together."""

NODES_OF_A_SEARCH = NODES_FOR_A_CONFLICT + NODES_FOR_MOVES + NODES_FOR_CHANGES

ITERATIONS_OF_A_NODE = 100
"""Iterations of the simplex method that count as a node."""

PAIRS_OF_A_NODE = 2_000
"""Pairs of a partition and a host that first fit may look at for the price of a node."""

FEWEST_PAIRS = 500
"""A question that first fit answers counts as at least so many pairs."""


@dataclass(slots=True)
class SearchBudget:
    """The rest of the nodes of a search, and the parts that ended at its limit."""

    nodes: Nodes
    part: str  # what is searched for now, as a noun of a sentence
    unfinished: dict[str, None] = field(default_factory=dict)  # in order
    _pairs: int = 0  # that first fit looked at and that are not a whole node yet

    @classmethod
    def of(cls, nodes: int, part: str) -> "SearchBudget":
        """Return a new budget.

        Args:
            nodes: Solver nodes in all.
            part: The first part of the search, as a noun.
        """
        return cls(Nodes(nodes, ITERATIONS_OF_A_NODE), part)

    def takes(self, pairs: int) -> bool:
        """Count a question to first fit, if anything is left.

        Args:
            pairs: Of a partition and a host that it may be on.

        Returns:
            Whether the question may be asked; if not, the part counts as unfinished.
        """
        if self.nodes.remaining <= 0:
            self.unfinished[self.part] = None
            return False
        spent, self._pairs = divmod(self._pairs + max(FEWEST_PAIRS, pairs), PAIRS_OF_A_NODE)
        self.nodes.remaining -= spent
        return True


def unfinished_parts(budgets: Iterable[SearchBudget]) -> tuple[str, ...]:
    """Return what was not searched to the end, as nouns.

    Args:
        budgets: In the order of their searches.
    """
    return tuple(dict.fromkeys(part for budget in budgets for part in budget.unfinished))
