"""Every kind of output there is. Only the schema needs them all: a command imports what it prints."""

from rarms_iac.views.output.combining import CandidatesOutput, GraphOutput, TuneOutput
from rarms_iac.views.output.common import ExplanationOutput, FindingsOutput, FmtOutput, WrittenOutput
from rarms_iac.views.output.hosts import (
    ComponentRunOutput,
    DoctorOutput,
    DriftOutput,
    HistoryOutput,
    RunOutput,
    StatusOutput,
    StepEndedOutput,
)
from rarms_iac.views.output.measuring import (
    ComponentExplanationOutput,
    MeasureOutput,
    ProveOutput,
    ReportOutput,
    SelectionOutput,
)
from rarms_iac.views.output.plan import PlanOutput, ScriptDifferenceOutput, ScriptsOutput

Output = (
    PlanOutput
    | RunOutput
    | StepEndedOutput
    | ComponentRunOutput
    | DriftOutput
    | DoctorOutput
    | StatusOutput
    | HistoryOutput
    | FindingsOutput
    | FmtOutput
    | WrittenOutput
    | ExplanationOutput
    | ComponentExplanationOutput
    | SelectionOutput
    | ScriptsOutput
    | ScriptDifferenceOutput
    | MeasureOutput
    | TuneOutput
    | ProveOutput
    | ReportOutput
    | GraphOutput
    | CandidatesOutput
)
