"""rarms: CPU reservations for components that must answer in time, from a manifest to an applied plan.

A program begins with `load`; what it returns goes into `measure`, `tune`, `plan` and `prove`, and a plan into `apply`
(docs/library.md). With them are their requests, results and errors. Each is imported when it is first asked for, so
that `import rarms_iac` costs nothing.
"""

from rarms_iac.model.version import __version__

TYPE_CHECKING = False  # type checkers know this name; to import typing would double the time of `rarms --version`

if TYPE_CHECKING:
    from rarms_iac.app.applying import apply
    from rarms_iac.app.control import Control, Reporter, StopSignal
    from rarms_iac.app.hosts import Hosts, load
    from rarms_iac.app.planning import plan, plan_request
    from rarms_iac.app.use_case_errors import Outcome, RequestError, UseCaseError
    from rarms_iac.applying.plan_request import PlanRequest
    from rarms_iac.applying.run_report import RunEnding, RunReport
    from rarms_iac.measuring.measure import MeasureOutcome
    from rarms_iac.measuring.measure import measure_components as measure
    from rarms_iac.measuring.measure_request import ExperimentResult, MeasureRequest
    from rarms_iac.measuring.prove import ProveOutcome, ProveRequest
    from rarms_iac.measuring.prove import prove_layout as prove
    from rarms_iac.measuring.tune import TuneRequest, TuningResult
    from rarms_iac.measuring.tune import tune_components as tune
    from rarms_iac.model.changes import Adopt, Change, Create, Delete, Release, Update
    from rarms_iac.model.diagnostics import Diagnostic, Severity
    from rarms_iac.model.plan import HostPlan, Plan, Purpose

__all__ = [
    "Adopt",
    "Change",
    "Control",
    "Create",
    "Delete",
    "Diagnostic",
    "ExperimentResult",
    "HostPlan",
    "Hosts",
    "MeasureOutcome",
    "MeasureRequest",
    "Outcome",
    "Plan",
    "PlanRequest",
    "ProveOutcome",
    "ProveRequest",
    "Purpose",
    "Release",
    "Reporter",
    "RequestError",
    "RunEnding",
    "RunReport",
    "Severity",
    "StopSignal",
    "TuneRequest",
    "TuningResult",
    "Update",
    "UseCaseError",
    "__version__",
    "apply",
    "load",
    "measure",
    "plan",
    "plan_request",
    "prove",
    "tune",
]

_NAMES = {
    "Adopt": ("model.changes", "Adopt"),
    "Change": ("model.changes", "Change"),
    "Create": ("model.changes", "Create"),
    "Delete": ("model.changes", "Delete"),
    "Release": ("model.changes", "Release"),
    "Update": ("model.changes", "Update"),
    "Control": ("app.control", "Control"),
    "Reporter": ("app.control", "Reporter"),
    "StopSignal": ("app.control", "StopSignal"),
    "Diagnostic": ("model.diagnostics", "Diagnostic"),
    "Severity": ("model.diagnostics", "Severity"),
    "HostPlan": ("model.plan", "HostPlan"),
    "Plan": ("model.plan", "Plan"),
    "Hosts": ("app.hosts", "Hosts"),
    "MeasureOutcome": ("measuring.measure", "MeasureOutcome"),
    "MeasureRequest": ("measuring.measure_request", "MeasureRequest"),
    "ExperimentResult": ("measuring.measure_request", "ExperimentResult"),
    "Outcome": ("app.use_case_errors", "Outcome"),
    "Purpose": ("model.plan", "Purpose"),
    "RequestError": ("app.use_case_errors", "RequestError"),
    "UseCaseError": ("app.use_case_errors", "UseCaseError"),
    "PlanRequest": ("applying.plan_request", "PlanRequest"),
    "plan_request": ("app.planning", "plan_request"),
    "ProveOutcome": ("measuring.prove", "ProveOutcome"),
    "ProveRequest": ("measuring.prove", "ProveRequest"),
    "RunEnding": ("applying.run_report", "RunEnding"),
    "RunReport": ("applying.run_report", "RunReport"),
    "TuneRequest": ("measuring.tune", "TuneRequest"),
    "TuningResult": ("measuring.tune", "TuningResult"),
    "apply": ("app.applying", "apply"),
    "load": ("app.hosts", "load"),
    "measure": ("measuring.measure", "measure_components"),
    "plan": ("app.planning", "plan"),
    "prove": ("measuring.prove", "prove_layout"),
    "tune": ("measuring.tune", "tune_components"),
}
"""The module below `rarms_iac` and the name there, by the name that a program uses."""


def __getattr__(name: str) -> object:
    """Import a name of the library when it is first used.

    Raises:
        AttributeError: there is none of this name.
    """
    if name not in _NAMES:
        raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
    from importlib import import_module

    module, attribute = _NAMES[name]
    value: object = getattr(import_module(f"rarms_iac.{module}"), attribute)
    return value
