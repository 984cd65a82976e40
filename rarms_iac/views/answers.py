"""The results that commands print with `--json`: each names itself in `kind` (`schemas/output.json`)."""

from rarms_iac.app.doctor import DoctorReport, Examinations
from rarms_iac.app.drift import DriftReport
from rarms_iac.app.explain import Explanation
from rarms_iac.app.graph import CandidateGraph, LayoutGraph
from rarms_iac.app.guide import GuideFacts
from rarms_iac.app.install import Installation
from rarms_iac.app.manifest_files import FormattedManifests, WrittenFiles
from rarms_iac.app.report_model import Report
from rarms_iac.app.scripts import PlanScripts
from rarms_iac.app.select import Selection
from rarms_iac.app.status import History, Overview
from rarms_iac.app.this_machine import StartedPartitions
from rarms_iac.applying.run_report import RunReport, StepEnded
from rarms_iac.measuring.measure import MeasureOutcome
from rarms_iac.measuring.prove import ProveOutcome
from rarms_iac.measuring.run_component import RunOutcome
from rarms_iac.measuring.tune import TuningResult
from rarms_iac.model.diagnostics import Findings
from rarms_iac.model.plan import Plan
from rarms_iac.powershell.comparison import ScriptDifference, TextDifference
from rarms_iac.storage.shipped import FindingPage

Answer = (
    CandidateGraph
    | DoctorReport
    | DriftReport
    | Examinations
    | Explanation
    | FindingPage
    | Findings
    | FormattedManifests
    | GuideFacts
    | History
    | Installation
    | LayoutGraph
    | MeasureOutcome
    | Overview
    | Plan
    | PlanScripts
    | ProveOutcome
    | Report
    | RunOutcome
    | RunReport
    | ScriptDifference
    | Selection
    | StartedPartitions
    | StepEnded
    | TextDifference
    | TuningResult
    | WrittenFiles
)
