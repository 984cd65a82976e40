"""What the data logs of components say of their thresholds: one verdict, which every view shows.

`planner/verdicts.py` makes it. The verdict on one setting is another one: `model/outcomes.py`.
"""

from dataclasses import dataclass
from enum import StrEnum

from rarms_iac.model.output import Internal, output
from rarms_iac.model.quantities import ReservePercent
from rarms_iac.model.system import Threshold


class Achievement(StrEnum):
    """How a threshold stands; a component stands as its worst threshold does. From good to bad."""

    MET = "met"
    UNMEASURED = "not measured"  # a load that the reservation must hold with has no data log that holds
    OPEN = "not shown yet"
    MISSED = "not achieved"


def worst(achievements: tuple[Achievement, ...]) -> Achievement:
    """Return the worst of them; of none, that nothing is measured."""
    order = tuple(Achievement)
    return max(achievements, key=order.index, default=Achievement.UNMEASURED)


@dataclass(frozen=True, slots=True, kw_only=True)
class ThresholdAchievement:
    """How one threshold of a component stands with all loads."""

    component: str
    index: str
    threshold: Threshold
    achievement: Achievement


@dataclass(frozen=True, slots=True, kw_only=True)
class ReservationVerdict:
    """What the data logs of the components of a partition say of their thresholds together."""

    thresholds: tuple[ThresholdAchievement, ...]
    interference: str = ""  # the load that asks for most; empty: nothing is measured
    so_far: Internal[ReservePercent | None] = None  # the least CR that is enough with the measured loads
    not_measured: tuple[str, ...] = ()  # loads without a data log that holds

    @property
    def achievement(self) -> Achievement:
        """Of the worst threshold."""
        return worst(tuple(each.achievement for each in self.thresholds))

    @output
    def reserve(self) -> ReservePercent | None:
        """The least CR at which every threshold holds with every load, in whole per cent; None: it is not known."""
        return self.so_far if self.achievement is Achievement.MET else None

    def of(self, component: str) -> Achievement:
        """Return the verdict of a component: how its worst threshold stands."""
        return worst(tuple(each.achievement for each in self.thresholds if each.component == component))

    def worst_indexes(self, component: str) -> tuple[str, ...]:
        """Name the indexes of a component that stand as it does."""
        achievement = self.of(component)
        own = (each for each in self.thresholds if each.component == component)
        return tuple(each.index for each in own if each.achievement is achievement)
