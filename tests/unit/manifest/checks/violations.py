"""Runs every check over a system, for the tests of this folder."""

from datetime import date

from rarms_iac.manifest.checks import run_checks
from rarms_iac.model.system import System
from tests.builders import PathPlaces


def found(system: System) -> list[tuple[str, str]]:
    """Code and path of everything the checks tell."""
    told = run_checks(system, PathPlaces(), date(2026, 1, 1))
    return [(diagnostic.code, diagnostic.place.path if diagnostic.place else "") for diagnostic in told]


def details(system: System) -> str:
    return "\n".join(check.detail for check in run_checks(system, PathPlaces(), date(2026, 1, 1)))
