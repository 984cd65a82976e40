"""rarms: CPU reservations for components that must answer in time, from a manifest to an applied plan.

A program begins with `load`; what it returns goes into `measure`, `tune`, `plan` and `prove`, and a plan into `apply`
(docs/library.md). Each of them is imported when it is first asked for, so that `import rarms_iac` costs nothing.
"""

from rarms_iac.model.version import __version__

TYPE_CHECKING = False  # type checkers know this name; to import typing would double the time of `rarms --version`

if TYPE_CHECKING:
    from rarms_iac.app.applying import apply
    from rarms_iac.app.experiments.measure import measure_components as measure
    from rarms_iac.app.experiments.prove import prove_layout as prove
    from rarms_iac.app.experiments.tune import tune_components as tune
    from rarms_iac.app.hosts import load
    from rarms_iac.app.planning import plan

__all__ = ["__version__", "apply", "load", "measure", "plan", "prove", "tune"]

_FUNCTIONS = {
    "apply": ("applying", "apply"),
    "load": ("hosts", "load"),
    "measure": ("experiments.measure", "measure_components"),
    "plan": ("planning", "plan"),
    "prove": ("experiments.prove", "prove_layout"),
    "tune": ("experiments.tune", "tune_components"),
}
"""The module of `rarms_iac.app` and the function there, by the name that a program uses."""


def __getattr__(name: str) -> object:
    """Import a function of the library when it is first used.

    Raises:
        AttributeError: there is none of this name.
    """
    if name not in _FUNCTIONS:
        raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
    from importlib import import_module

    module, function = _FUNCTIONS[name]
    use_case: object = getattr(import_module(f"rarms_iac.app.{module}"), function)
    return use_case
