"""What the page shows: manifest, data logs, hosts and history, looked up again when one of their files changed."""

import hashlib
import os
import time
from collections.abc import Callable, Iterator, Sequence
from contextlib import suppress
from dataclasses import dataclass, field, replace
from datetime import UTC, datetime
from pathlib import Path
from threading import Lock

from rarms_iac.app.files import folder_of
from rarms_iac.app.hosts import select_hosts
from rarms_iac.app.manifests import Manifest, load_manifest
from rarms_iac.app.report import measured_report
from rarms_iac.app.report_model import Report
from rarms_iac.app.requests import HostSelection, ManifestSource, today_utc
from rarms_iac.app.status import History, Overview, history_of_hosts, overview_of
from rarms_iac.app.use_case_errors import UseCaseError, system_finding
from rarms_iac.app.wiring import HOSTS, state_folder
from rarms_iac.manifest.load import manifest_path
from rarms_iac.model.diagnostics import Diagnostic, Sources, in_order
from rarms_iac.model.host import Host, ProviderKind
from rarms_iac.storage.disk import MEASUREMENTS
from rarms_iac.texts.findings import first_of_each_kind


@dataclass(frozen=True, slots=True, kw_only=True)
class Knowledge:
    """The known state of an application at a moment."""

    version: str  # of the files that it was read from
    manifest: Manifest | None = None  # None: it has errors
    report: Report | None = None
    overview: Overview | None = None
    history: History | None = None
    looked_at: str = ""  # when the hosts were looked at: `10:11:12 UTC`; empty: they were not
    findings: tuple[Diagnostic, ...] = ()
    sources: Sources = field(default_factory=dict)  # that the findings point into


LOOK_SECONDS = 30
"""How old may be what is known of a host whose files lie on another machine, or are none, or that a run holds."""


def is_followed(host: Host) -> bool:
    """Return whether each change and the holder of a host are seen: its files are on this machine."""
    return host.provider is ProviderKind.SIMULATED or state_folder(host) is not None


def files_version(source: ManifestSource, folders: Sequence[Path]) -> str:
    """Return a digest of what files look like: their names, sizes and times of change.

    Args:
        source: the manifest and its overlays; data logs and simulated hosts lie below its folder.
    """
    digest = hashlib.sha256()
    for path in _files(source, folders):
        with suppress(OSError):
            status = path.stat()
            digest.update(f"{path}\0{status.st_mtime_ns}\0{status.st_size}\0{status.st_ino}\n".encode(errors="replace"))
    return digest.hexdigest()[:16]


def _files(source: ManifestSource, more: Sequence[Path]) -> Iterator[Path]:
    yield from (Path(manifest_path(source.manifest)), *map(Path, source.overlays))
    own = folder_of(source.manifest)
    for root in (own / MEASUREMENTS, own / HOSTS, *more):
        for folder, folders, files in os.walk(root):
            folders.sort()
            yield from (Path(folder, file) for file in sorted(files) if not file.startswith("."))


def look(source: ManifestSource, version: str) -> Knowledge:
    """Read the manifest and the logs, and look at the hosts. Changes nothing.

    Args:
        source: the manifest and its overlays; its day is not read, since a studio may run for longer.
        version: of its files, before they are read.

    Returns:
        What is known; findings report what could not be read.
    """
    known = Knowledge(version=version)
    try:
        manifest = load_manifest(replace(source, today=today_utc()))
        known = replace(known, manifest=manifest, sources=manifest.sources, findings=manifest.findings)
        report = measured_report(manifest, with_candidates=True)
        known = replace(known, report=report)
        hosts = select_hosts(manifest, HostSelection())
        looked_at = datetime.now(UTC).strftime("%H:%M:%S UTC")
        overview = overview_of(hosts, report, explain=True)  # its page has a button for each way out
        findings = first_of_each_kind(in_order((*manifest.findings, *overview.problems)))
        report = replace(report, proofs=overview.proofs)  # compared with the hosts
        known = replace(known, report=report, overview=overview, findings=findings, looked_at=looked_at)
        return replace(known, history=history_of_hosts(hosts))
    except UseCaseError as error:
        findings = first_of_each_kind(in_order((*known.findings, *error.findings)))
        return replace(known, findings=findings, sources=error.sources or known.sources)
    except OSError as error:  # a log that is not a regular file, or that may not be read
        return replace(known, findings=first_of_each_kind(in_order((*known.findings, system_finding(error)))))


class Watch:
    """Keeps what is known until a file changes. Several threads may ask.

    Args:
        source: the manifest and its overlays.
        now: seconds.
    """

    def __init__(self, source: ManifestSource, now: Callable[[], float] = time.monotonic) -> None:
        self._source = source
        self._now = now
        self._lock = Lock()
        self._known: Knowledge | None = None
        self._looks = 0

    def knowledge(self) -> Knowledge:
        """Return the present knowledge; it is looked up again if a file changed."""
        with self._lock:
            version = self._version()
            if self._known is None or self._known.version != version:
                self._known = look(self._source, version)
            return self._known

    def version(self, *, is_running: bool) -> str:
        """Return a text that changes with each file, and from time to time where a host has no file here.

        Args:
            is_running: whether a use case runs, which is left alone with its hosts.
        """
        with self._lock:
            if not is_running:
                self._looks = int(self._now()) // LOOK_SECONDS
            return self._version()

    def _version(self) -> str:
        hosts = self._known.manifest.system.hosts.values() if self._known and self._known.manifest else ()
        folders = [folder for host in hosts if (folder := state_folder(host)) is not None]
        is_held = self._known and self._known.overview and any(host.held_by for host in self._known.overview.hosts)
        is_looked_at = is_held or not all(map(is_followed, hosts))  # a run that is killed changes no file
        return f"{files_version(self._source, folders)}{f'-{self._looks}' if is_looked_at else ''}"

    def forget(self) -> None:
        """Let everything be looked up again: a host that is not a file may have changed."""
        with self._lock:
            if self._known is not None:
                self._known = replace(self._known, version="")
