"""Reading the manifest that the options name, with every check, for commands that need to know what it says."""

from collections.abc import Sequence
from dataclasses import dataclass
from datetime import date
from pathlib import Path

from rarms_iac.cli.codes import ExitCode
from rarms_iac.cli.options import ManifestOptions
from rarms_iac.cli.problems import Halted
from rarms_iac.manifest.acceptance import apply_acceptances
from rarms_iac.manifest.checks import LOOKED_FOR, checks_beside, run_checks
from rarms_iac.manifest.load import Loaded, load, manifest_path
from rarms_iac.model.diagnostics import Diagnostic, has_errors
from rarms_iac.model.system import System


@dataclass(frozen=True, slots=True, kw_only=True)
class Opened:
    """A manifest as it was read, what is told of it, and what its policy accepts."""

    loaded: Loaded
    findings: tuple[Diagnostic, ...]
    accepted: tuple[Diagnostic, ...]

    @property
    def has_errors(self) -> bool:
        """Whether only `validate` may go on."""
        return has_errors(self.findings)


def open_manifest(path: str, overlays: Sequence[str], today: date, *, planning: bool = True) -> Opened:
    """Read and check it; whatever is wrong is among the findings.

    Who does not plan is warned of reserves that are not measured yet; else that is for the planner to tell.
    """
    named = manifest_path(path)
    checks = run_checks if planning else checks_beside(Path(named).parent)
    loaded = load(named, tuple(overlays), today=today, checks=checks)
    if loaded.system is None:
        return Opened(loaded=loaded, findings=loaded.diagnostics, accepted=())
    kept, accepted = apply_acceptances(
        loaded.diagnostics, loaded.system.policy, loaded.places, today, looked_for=LOOKED_FOR
    )
    return Opened(loaded=loaded, findings=kept, accepted=accepted)


def system_of(source: ManifestOptions) -> tuple[System, Opened]:
    """What the manifest says.

    Raises:
        Halted: it has errors (exit 4).
    """
    opened = open_manifest(source.manifest, source.overlays, source.today)
    system = opened.loaded.system
    if system is None or opened.has_errors:
        raise Halted(ExitCode.NO, opened.findings, opened.loaded.sources)
    return system, opened
