"""What is known of components in one partition with one load: their data log, or why there is none."""

from collections.abc import Callable, Mapping
from dataclasses import dataclass

from rarms_iac.model.commands import MEASURE, RecommendedCommand, Wording
from rarms_iac.model.diagnostics import Diagnostic, Finding, Given
from rarms_iac.model.processor_number import ProcessorSource
from rarms_iac.planner import planning_findings
from rarms_iac.statistics.curves import Curve
from rarms_iac.storage.datalog.log import DataLog

Names = tuple[str, ...]
"""Components together in one partition, in the order of their names."""


@dataclass(frozen=True, slots=True, kw_only=True)
class NotMeasured:
    """There is no answer for these components, and why."""

    components: Names
    interference: str = ""  # the load whose data log is missing or does not hold; empty: there is no load to name
    why: Diagnostic  # without a place; `explained` makes it


def explained(
    finding: Finding, components: Names, platform: str, template: str, advice: Wording, **facts: Given
) -> Diagnostic:
    """Return why the reservation of components on a platform is not known, at the first of them.

    A partition whose reserve is fixed has no such component.
    """
    address = f"component/{components[0]}" if components else ""
    about: Mapping[str, Given] = {"components": components, "platform": platform, **facts}
    return finding.at(None, template, advice, address=address, related=(), **about)


def without_log(components: Names, platform: str) -> NotMeasured:
    """Return that no data log has the reservation of these components."""
    template = "The reservation of {components:each} on platform {platform} is to be measured, and no data log has it."
    advice = "Fix it with `cpu: { reserve: ... }`, or measure it first."
    why = explained(planning_findings.UNMEASURED, components, platform, template, advice)
    return NotMeasured(components=components, why=why)


@dataclass(frozen=True, slots=True, kw_only=True)
class MeasuredTogether:
    """The data log of components in one partition with one load, for the hosts that it holds for."""

    path: str  # as messages name it
    interference: str  # the load
    processors: int  # of P1: a CR is per cent of these
    measured: tuple[int, ...]  # the CRs that were measured, ascending
    least: int | None = None  # the least CR that is enough with every load, as `decide` found it; None: none is
    curves: Callable[[str, str], Curve]  # by component and index
    records: DataLog  # that the curves are of
    others: int = 0  # settings in the same file that were measured under other conditions, and do not count
    remarks: tuple[Diagnostic, ...] = ()  # as of `LookedUp`
    again: RecommendedCommand = MEASURE  # what measures it
    weak: bool = False  # its load cannot take all that P2 reserves, or left some of it idle
    cpu_ms: Callable[[str], float | None] = lambda _component: None  # processor time of a component's job, on average
    processors_from: ProcessorSource = ProcessorSource.HOST
    used: int | None = None  # the most processors that they were seen to use at once; None: that was not seen

    def measured_below(self, reserve: int) -> int:
        """Return the next lower CR that was measured; 0: none was.

        Args:
            reserve: the CR in per cent of P1's own processors.
        """
        return max((each for each in self.measured if each < reserve), default=0)


LogOfLoad = MeasuredTogether | NotMeasured
"""What is known with one load."""
