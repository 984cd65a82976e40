"""Reading a manifest with every check, for use cases that need to know what it says."""

from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path

from rarms_iac.app.requests import ManifestSource
from rarms_iac.app.use_case_errors import Outcome, UseCaseError
from rarms_iac.manifest.acceptance import apply_acceptances
from rarms_iac.manifest.checks import CODES
from rarms_iac.manifest.load import Loaded, load_system, manifest_path
from rarms_iac.manifest.text.reading import read_yaml
from rarms_iac.model.diagnostics import Diagnostic, Places, has_errors
from rarms_iac.model.system import Component, System
from rarms_iac.running.secrets import short_secrets
from rarms_iac.storage.reading import STANDARD_INPUT


@dataclass(frozen=True, slots=True, kw_only=True)
class Manifest:
    """A manifest without errors: what it says, and where in its files it says so."""

    source: ManifestSource
    system: System
    loaded: Loaded
    findings: tuple[Diagnostic, ...] = ()  # warnings and notes that its policy does not accept

    @property
    def places(self) -> Places:
        """Where each value stands in the files."""
        return self.loaded.places

    @property
    def sources(self) -> Mapping[str, Sequence[str]]:
        """The lines of each file, by the name that places use."""
        return self.loaded.sources

    @property
    def folder(self) -> Path:
        """The folder that the manifest's paths are relative to."""
        return Path(self.loaded.folder)

    @property
    def code_folder(self) -> Path:
        """The folder of the components' files."""
        return Path(self.source.code) if self.source.code else self.folder


def load_manifest(source: ManifestSource) -> Manifest:
    """Read a manifest that must be right.

    Args:
        source: the manifest, its overlays in order, and the day by which acceptances expire.

    Returns:
        The manifest; with its warnings and notes.

    Raises:
        UseCaseError: a file is not there (missing), or it has errors (negative); they are its findings.
    """
    loaded = load_system(manifest_path(source.manifest), source.overlays, today=source.today)
    if loaded.system is None:
        outcome = Outcome.MISSING if loaded.is_missing else Outcome.NEGATIVE
        raise UseCaseError(outcome, loaded.diagnostics, loaded.sources)
    remaining, _ = apply_acceptances(loaded.diagnostics, loaded.system.policy, loaded.places, source.today, codes=CODES)
    if has_errors(remaining):
        raise UseCaseError(Outcome.NEGATIVE, remaining, loaded.sources)
    return Manifest(source=source, system=_seen_from(source, loaded.system), loaded=loaded, findings=remaining)


def _seen_from(source: ManifestSource, system: System) -> System:
    """Return the system as the machine sees it that the source names."""
    if not source.here:
        return system
    here = replace(system.hosts[source.here], connect=None)
    return replace(system, hosts={**system.hosts, source.here: here})


def unaccepted_short_secrets(manifest: Manifest, components: Iterable[Component]) -> tuple[Diagnostic, ...]:
    """Return the findings of `short_secrets` for started components, without those that the policy accepts."""
    found, policy = tuple(short_secrets(components, manifest.places)), manifest.system.policy
    return apply_acceptances(found, policy, manifest.places, manifest.source.today, codes=())[0]


def declared_application(source: ManifestSource) -> str | None:
    """Return the application's name as a manifest and its overlays have it; None where none of them says one.

    Args:
        source: the files; they may have errors elsewhere.
    """
    name: str | None = None
    for block in _declared(source, "application"):
        declared = block.get("name")
        name = declared if isinstance(declared, str) else name
    return name


def demands_signed_plans(source: ManifestSource) -> bool:
    """Tell whether a manifest's policy, or that of its last overlay that says so, wants plans that are signed.

    Args:
        source: the files; they may have errors elsewhere.
    """
    demands = [block["signed_plans"] for block in _declared(source, "policy") if "signed_plans" in block]
    return bool(demands) and demands[-1] is True


def _declared(source: ManifestSource, section: str) -> Iterator[Mapping[str, object]]:
    """Yield a section of the manifest and of each overlay, as far as they have it."""
    for path in (manifest_path(source.manifest), *source.overlays):
        document = read_yaml(path).value
        block = document.get(section) if isinstance(document, dict) else None
        if isinstance(block, dict):
            yield block


def declared_names(manifest: str, section: str) -> tuple[str, ...]:
    """Return the keys of a section of a manifest, which may have errors elsewhere.

    Args:
        section: as `components`.

    Returns:
        In the file's order; none where it cannot be read, or is standard input.
    """
    document = None if manifest == STANDARD_INPUT else read_yaml(manifest_path(manifest)).value
    entries = document.get(section) if isinstance(document, dict) else None
    return tuple(entries) if isinstance(entries, dict) else ()
