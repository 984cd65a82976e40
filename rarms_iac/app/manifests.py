"""Reading manifests with every check: one that must be right, or every finding of many that needs no host."""

import os
import re
from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from itertools import chain
from pathlib import Path

from rarms_iac.app.requests import ManifestSource
from rarms_iac.app.use_case_errors import Outcome, UseCaseError
from rarms_iac.manifest.acceptance import apply_acceptances
from rarms_iac.manifest.checks import CODES
from rarms_iac.manifest.load import DEFAULT_NAME, Loaded, load_system, manifest_path
from rarms_iac.manifest.text.reading import MAX_BYTES, read_yaml
from rarms_iac.model.diagnostics import Diagnostic, Places, Severity, has_errors, in_order
from rarms_iac.model.host import ProviderKind
from rarms_iac.model.system import Component, System
from rarms_iac.running.as_root import components_as_root, run_as_root
from rarms_iac.running.secrets import short_secrets
from rarms_iac.storage.reading import STANDARD_INPUT, read_file
from rarms_iac.texts.findings import first_of_each_kind
from rarms_iac.texts.messages import did_you_mean


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


def start_warnings(manifest: Manifest, components: Sequence[Component]) -> tuple[Diagnostic, ...]:
    """Return the warnings about components that are started as processes, without those that the policy accepts."""
    short = tuple(short_secrets(components, manifest.places))
    as_root = components_as_root(components) if has_own_partitions(manifest.system) else ()
    left = tuple(name for name in as_root if _unaccepted(manifest, (run_as_root((name,), manifest.places),)))
    return (*_unaccepted(manifest, short), *((run_as_root(left, manifest.places),) if left else ()))


def has_own_partitions(system: System) -> bool:
    """Tell whether a host of the manifest is this machine: a Linux host without a connection."""
    return any(host.provider is ProviderKind.LINUX and host.connect is None for host in system.hosts.values())


def _unaccepted(manifest: Manifest, found: Sequence[Diagnostic]) -> tuple[Diagnostic, ...]:
    return apply_acceptances(found, manifest.system.policy, manifest.places, manifest.source.today, codes=())[0]


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

    Returns:
        In the file's order; none where it cannot be read, or is standard input.
    """
    document = None if manifest == STANDARD_INPUT else read_yaml(manifest_path(manifest)).value
    entries = document.get(section) if isinstance(document, dict) else None
    return tuple(entries) if isinstance(entries, dict) else ()


_KEY = re.compile(rb"^([A-Za-z_]+)[ \t]*:", re.MULTILINE)
_OVERLAY_KEYS = frozenset(
    ("application", "hosts", "components", "partitions", "interference", "tasks", "policy", "moved")
)
_LONG = 6
_SUFFIXES = (".yaml", ".yml")


@dataclass(frozen=True, slots=True, kw_only=True)
class Validation:
    """The findings in order, each once, and the lines of the files."""

    findings: tuple[Diagnostic, ...]
    accepted: tuple[Diagnostic, ...]
    sources: Mapping[str, Sequence[str]]
    is_missing: bool = False  # a file that was named is not there

    def fails(self, *, strict: bool = False) -> bool:
        """Return whether there are errors, or warnings in a strict validation.

        Returns:
            Whether the exit code says no; notes never make it so.
        """
        severities = {finding.severity for finding in self.findings}
        return Severity.ERROR in severities or (strict and Severity.WARNING in severities)


def validate(sources: Sequence[ManifestSource]) -> Validation:
    """Check manifests, each with its overlays, as far as that can be done without a host.

    Args:
        sources: as `sources_in` finds them. Otherwise only files below a manifest's folder are read.

    Returns:
        The findings of all, each once, in the order of their places; the first of each kind.
    """
    checked = [validate_manifest(source) for source in sources]
    return Validation(
        findings=first_of_each_kind(in_order(_each_once(each.findings for each in checked))),
        accepted=first_of_each_kind(_each_once(each.accepted for each in checked)),
        sources={file: lines for each in checked for file, lines in each.sources.items()},
        is_missing=any(each.is_missing for each in checked),
    )


def _each_once(findings: Iterable[Sequence[Diagnostic]]) -> tuple[Diagnostic, ...]:
    return tuple(dict.fromkeys(chain.from_iterable(findings)))


def validate_manifest(source: ManifestSource) -> Validation:
    """Check one manifest with its overlays; what it means is checked once its structure is right.

    Args:
        source: the manifest, its overlays, and the day by which acceptances expire.

    Returns:
        Its findings, in the order of their places.
    """
    loaded = load_system(manifest_path(source.manifest), source.overlays, today=source.today)
    system = loaded.system
    if system is None:
        return Validation(
            sources=loaded.sources, findings=loaded.diagnostics, accepted=(), is_missing=loaded.is_missing
        )
    # Imported here: what cannot be read does not need the planner.
    from rarms_iac.app.declared_hosts import declared_host_findings

    errors = [finding for finding in loaded.diagnostics if finding.severity is Severity.ERROR]
    beyond = declared_host_findings(Manifest(source=source, system=system, loaded=loaded), errors)
    remaining, accepted = apply_acceptances(
        in_order([*loaded.diagnostics, *beyond, *short_secrets(system.components.values(), loaded.places)]),
        system.policy,
        loaded.places,
        source.today,
        codes=CODES,
    )
    return Validation(sources=loaded.sources, findings=remaining, accepted=accepted)


def sources_in(paths: Sequence[str], source: ManifestSource) -> tuple[ManifestSource, ...]:
    """Find the manifests that are meant, and for each overlay the manifest that it belongs to.

    An overlay is a YAML file that has sections of a manifest and no `schema`. It belongs to a `rarms.yaml` next to it,
    else to that of the nearest folder above.

    Args:
        paths: files, `-`, or folders, which are walked; hidden folders are not, and links are not followed.
        source: how each is read. Where it has overlays, every file is the manifest of them.

    Returns:
        One a manifest or overlay, in the order of the paths.
    """
    files = dict.fromkeys(file for path in paths for file in _files_in(path))
    if source.overlays:
        return tuple(replace(source, manifest=file) for file in files)
    found: dict[tuple[str, ...], ManifestSource] = {}
    for file in files:
        manifest = _manifest_of(file) if file != STANDARD_INPUT and _is_overlay(file) else None
        overlays = () if manifest is None else (file,)
        made = replace(source, manifest=manifest or file, overlays=overlays)
        found.setdefault((made.manifest, *overlays), made)
    return tuple(found.values())


def _files_in(path: str) -> Iterator[str]:
    """Yield a file itself, and of a folder every manifest and overlay.

    Of a folder without any, yield the manifest that should be there.
    """
    if path == STANDARD_INPUT or not Path(path).is_dir():
        yield path
        return
    found = [
        file
        for file in _walk(path)
        if Path(file).name == DEFAULT_NAME or _is_manifest(file) or (_is_overlay(file) and _manifest_of(file))
    ]
    yield from found or [manifest_path(path)]


def _walk(folder: str) -> Iterator[str]:
    for root, folders, names in os.walk(folder):
        folders[:] = sorted(name for name in folders if not name.startswith("."))
        for name in sorted(names):
            file = Path(root) / name
            if name.endswith(_SUFFIXES) and file.is_file() and not file.is_symlink():
                yield str(file)


def _manifest_of(overlay: str) -> str | None:
    """Return the nearest manifest next to or above an overlay, up to the current folder or that of the repository."""
    for folder in Path(overlay).absolute().parents:
        manifest = folder / DEFAULT_NAME
        if manifest.is_file():
            return os.path.relpath(manifest) if not Path(overlay).is_absolute() else str(manifest)
        if (folder / ".git").exists() or folder == Path.cwd():
            break
    return None


def _is_manifest(file: str) -> bool:
    return re.search(rb"^schema[ \t]*:[ \t]*['\"]?rarms/", _text_of(file), re.MULTILINE) is not None


def _is_overlay(file: str) -> bool:
    """Return whether the keys are a manifest's, also misspelt, without `schema`; the file need not be valid YAML."""
    keys = {key.decode() for key in _KEY.findall(_text_of(file))}
    unknown = keys - _OVERLAY_KEYS
    shortest = _LONG if unknown == keys else 0  # a short word alone, as `host` or `task`, may be another program's
    return bool(keys) and all(len(key) >= shortest and did_you_mean(key, _OVERLAY_KEYS) for key in unknown)


def _text_of(file: str) -> bytes:
    try:
        return read_file(file, MAX_BYTES)
    except (OSError, ValueError):
        return b""  # who reads it as a manifest reports why
