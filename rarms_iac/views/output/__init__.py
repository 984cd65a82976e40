"""The one machine-readable form of what rarms says: `schemas/output.json` is made from these types.

Within `rarms-output/1` fields and kinds may be added; none changes its meaning or goes. Amounts are plain numbers:
memory in bytes, reserve and limit in whole per cent of each virtual processor.
"""

from rarms_iac.views.output.combining import CandidatesOutput, GraphOutput, TuneOutput
from rarms_iac.views.output.common import (
    FORMAT_VERSION,
    ExplanationOutput,
    FindingsOutput,
    FmtOutput,
    VersionOutput,
    WrittenOutput,
)
from rarms_iac.views.output.hosts import ComponentRunOutput, DoctorOutput, DriftOutput, RunOutput
from rarms_iac.views.output.measuring import MeasureOutput, ProveOutput, ReportOutput, SelectionOutput, WalkOutput
from rarms_iac.views.output.plan import PlanOutput, ScriptDifferenceOutput, ScriptsOutput

__all__ = ["FORMAT_VERSION", "Output"]

Output = (
    PlanOutput
    | RunOutput
    | ComponentRunOutput
    | DriftOutput
    | DoctorOutput
    | FindingsOutput
    | FmtOutput
    | WrittenOutput
    | ExplanationOutput
    | WalkOutput
    | SelectionOutput
    | ScriptsOutput
    | ScriptDifferenceOutput
    | MeasureOutput
    | TuneOutput
    | ProveOutput
    | ReportOutput
    | GraphOutput
    | CandidatesOutput
    | VersionOutput
)
