"""Limits of the search for the reasons why a manifest does not fit, in solver nodes.

A limit in seconds would give other answers on other computers.
"""

from dataclasses import dataclass, field

from rarms_iac.planner.packing.highs import Nodes

NODES_FOR_A_CONFLICT = 50
"""Solver nodes of the search for a smallest conflict."""

NODES_FOR_MOVES = 50
"""Solver nodes of the search for the fewest partitions that have to move."""

NODES_FOR_CHANGES = 100
"""Solver nodes of the search for changes of the manifest, of all kinds together."""

NODES_OF_A_SEARCH = NODES_FOR_A_CONFLICT + NODES_FOR_MOVES + NODES_FOR_CHANGES

ITERATIONS_OF_A_NODE = 100
"""Iterations of the simplex method that count as one node."""

PAIRS_OF_A_NODE = 2_000
"""Pairs of a partition and a host in first fit that count as one node."""

FEWEST_PAIRS = 500
"""Each run of first fit counts as at least this number of pairs."""


@dataclass(slots=True)
class SearchBudget:
    """The remaining nodes of a search, and the parts of it that reached the limit."""

    nodes: Nodes
    unfinished: dict[str, None] = field(default_factory=dict)  # in order
    _pairs: int = 0  # of first fit, less than one node

    @classmethod
    def of(cls, nodes: int) -> "SearchBudget":
        """Return a new budget.

        Args:
            nodes: The number of the solver's nodes that it allows.
        """
        return cls(Nodes(nodes, ITERATIONS_OF_A_NODE))

    def takes(self, part: str, pairs: int) -> bool:
        """Count a run of first fit, if nodes remain.

        Args:
            pairs: The number of pairs of a partition and a host that it may be on.

        Returns:
            Whether first fit may run; if not, the part counts as unfinished.
        """
        if self.nodes.remaining <= 0:
            self.unfinished[part] = None
            return False
        spent, self._pairs = divmod(self._pairs + max(FEWEST_PAIRS, pairs), PAIRS_OF_A_NODE)
        self.nodes.remaining -= spent
        return True
