"""Reading a manifest with every check, for use cases that need to know what it says."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path

from rarms_iac.app.errors import Outcome, UseCaseError
from rarms_iac.app.requests import ManifestSource
from rarms_iac.manifest.acceptance import apply_acceptances
from rarms_iac.manifest.checks import CODES, checks_beside, run_checks
from rarms_iac.manifest.load import Loaded, load, manifest_path
from rarms_iac.model.diagnostics import Diagnostic, Places, has_errors
from rarms_iac.model.system import System


@dataclass(frozen=True, slots=True, kw_only=True)
class CheckedManifest:
    """A manifest as it was read, its findings, and those that its policy accepts."""

    loaded: Loaded
    findings: tuple[Diagnostic, ...]
    accepted: tuple[Diagnostic, ...]

    @property
    def has_errors(self) -> bool:
        """Whether nothing but `validate` may use it."""
        return has_errors(self.findings)


@dataclass(frozen=True, slots=True, kw_only=True)
class Manifest:
    """A manifest without errors: what it says, and where in its files it says so."""

    source: ManifestSource
    system: System
    loaded: Loaded

    @property
    def places(self) -> Places:
        """Where each value stands in the files."""
        return self.loaded.places

    @property
    def sources(self) -> Mapping[str, Sequence[str]]:
        """The lines of each file, by the name that places use."""
        return self.loaded.sources

    @property
    def folder(self) -> str:
        """The folder that the manifest's paths are relative to."""
        return self.loaded.folder


def check_manifest(source: ManifestSource, *, planning: bool = True) -> CheckedManifest:
    """Read and check a manifest with its overlays; whatever is wrong is among the findings.

    Args:
        source: the manifest, its overlays, and the day by which acceptances expire.
        planning: whether the planner follows, which itself reports reserves that are not measured yet; without it
            they are a warning here.
    """
    path = manifest_path(source.manifest)
    checks = run_checks if planning else checks_beside(Path(path).parent)
    loaded = load(path, source.overlays, today=source.today, checks=checks)
    if loaded.system is None:
        return CheckedManifest(loaded=loaded, findings=loaded.diagnostics, accepted=())
    remaining, accepted = apply_acceptances(
        loaded.diagnostics, loaded.system.policy, loaded.places, source.today, codes=CODES
    )
    return CheckedManifest(loaded=loaded, findings=remaining, accepted=accepted)


def load_manifest(source: ManifestSource) -> Manifest:
    """Read a manifest that must be right.

    Raises:
        UseCaseError: it has errors (negative); they are its diagnostics.
    """
    checked = check_manifest(source)
    system = checked.loaded.system
    if system is None or checked.has_errors:
        raise UseCaseError(Outcome.NEGATIVE, checked.findings, checked.loaded.sources)
    return Manifest(source=source, system=system, loaded=checked.loaded)
