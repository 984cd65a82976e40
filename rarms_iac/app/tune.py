"""Tuning: components are combined into partitions, so that less is reserved."""

from dataclasses import dataclass
from typing import Literal

from rarms_iac.planner.combining.oracle import Asked
from rarms_iac.storage.datalog.tuning import TunedPartition, claim_of

TuningEnding = Literal["nothing_to_do", "successful", "unable", "stopped"]


@dataclass(frozen=True, slots=True, kw_only=True)
class TuningResult:
    """How `rarms tune` ended; amounts in per cent of one logical processor."""

    platform: str  # of the hosts that share `capacity`
    strategy: Literal["default", "paper"]
    ending: TuningEnding
    message: str
    capacity: int
    before: int
    after: int
    proved: bool
    probability: float | None  # that no other layout is better; None: it is proved, or nothing is claimed
    contradictions: tuple[str, ...]
    partitions: tuple[TunedPartition, ...]
    trail: tuple[Asked, ...]
    written: str = ""

    @property
    def claim(self) -> str:
        """What is said of other layouts."""
        return claim_of(self.proved, self.probability)
