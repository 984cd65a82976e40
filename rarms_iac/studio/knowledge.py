"""What the page shows: manifest, data logs, hosts and history, looked up anew when one of their files changed."""

import hashlib
import os
from collections.abc import Iterator
from contextlib import suppress
from dataclasses import dataclass, field, replace
from pathlib import Path
from threading import Lock

from rarms_iac.app.files import folder_of
from rarms_iac.app.general_findings import system_finding
from rarms_iac.app.hosts import select_hosts
from rarms_iac.app.manifests import Manifest, load_manifest
from rarms_iac.app.report import measured_report
from rarms_iac.app.report_model import Report
from rarms_iac.app.requests import HostSelection, ManifestSource, today_utc
from rarms_iac.app.status import History, Overview, history_of_hosts, overview_of
from rarms_iac.app.use_case_errors import UseCaseError
from rarms_iac.app.wiring import HOSTS
from rarms_iac.manifest.load import manifest_path
from rarms_iac.model.diagnostics import Diagnostic, Sources, first_of_each_kind, in_order
from rarms_iac.storage.disk import MEASUREMENTS


@dataclass(frozen=True, slots=True, kw_only=True)
class Knowledge:
    """What is known of an application at a moment."""

    version: str  # of the files that it was read from
    manifest: Manifest | None = None  # None: it has errors
    report: Report | None = None
    overview: Overview | None = None
    history: History | None = None
    findings: tuple[Diagnostic, ...] = ()
    sources: Sources = field(default_factory=dict)  # that the findings point into


def files_version(source: ManifestSource) -> str:
    """Return a digest of what the files beside a manifest look like: their names, sizes and times of change.

    Args:
        source: the manifest and its overlays; data logs and simulated hosts lie below its folder.
    """
    digest = hashlib.sha256()
    for path in _files(source):
        with suppress(OSError):
            status = path.stat()
            digest.update(f"{path}\0{status.st_mtime_ns}\0{status.st_size}\0{status.st_ino}\n".encode(errors="replace"))
    return digest.hexdigest()[:16]


def _files(source: ManifestSource) -> Iterator[Path]:
    yield from (Path(manifest_path(source.manifest)), *map(Path, source.overlays))
    for name in (MEASUREMENTS, HOSTS):
        for folder, folders, files in os.walk(Path(folder_of(source.manifest)) / name):
            folders.sort()
            yield from (Path(folder, file) for file in sorted(files) if not file.startswith("."))


def look(source: ManifestSource) -> Knowledge:
    """Read the manifest and the logs, and look at the hosts. Changes nothing.

    Args:
        source: the manifest and its overlays; its day is not read, since a studio may run for longer.

    Returns:
        What is known; what could not be read is told by findings.
    """
    known = Knowledge(version=files_version(source))
    try:
        manifest = load_manifest(replace(source, today=today_utc()))
        known = replace(known, manifest=manifest, sources=manifest.sources, findings=manifest.findings)
        report = measured_report(manifest, with_candidates=True)
        known = replace(known, report=report)
        hosts = select_hosts(manifest, HostSelection())
        overview = overview_of(hosts, report)
        findings = first_of_each_kind(in_order((*manifest.findings, *overview.problems)))
        known = replace(known, overview=overview, findings=findings)
        return replace(known, history=history_of_hosts(hosts))
    except UseCaseError as error:
        findings = first_of_each_kind(in_order((*known.findings, *error.findings)))
        return replace(known, findings=findings, sources=error.sources or known.sources)
    except OSError as error:  # a log that is no regular file, or that may not be read
        return replace(known, findings=first_of_each_kind(in_order((*known.findings, system_finding(error)))))


class Watch:
    """Keeps what is known until a file changes. Several threads may ask.

    Args:
        source: the manifest and its overlays.
    """

    def __init__(self, source: ManifestSource) -> None:
        self._source = source
        self._lock = Lock()
        self._known: Knowledge | None = None

    def now(self) -> Knowledge:
        """Return what is known; it is looked up anew where a file changed."""
        with self._lock:
            if self._known is None or self._known.version != files_version(self._source):
                self._known = look(self._source)
            return self._known

    def forget(self) -> None:
        """Have everything looked up anew: a host that is no file may have changed."""
        with self._lock:
            self._known = None
