"""Measuring: experiments with their data logs, on hosts that are held meanwhile."""

from dataclasses import dataclass

from rarms_iac.measuring.setup import Experiment
from rarms_iac.model.measurement import Setting
from rarms_iac.model.outcomes import Conclusion
from rarms_iac.statistics.curves import LeastReserve


@dataclass(frozen=True, slots=True, kw_only=True)
class ExperimentResult:
    """An experiment with its end."""

    experiment: Experiment
    conclusion: Conclusion
    settings: tuple[Setting, ...]  # all that its end rests on
    new: int  # how many of them were run now
    planned: LeastReserve | None  # what a plan reserves by the curve
    log: str  # path
