"""Data logs for reports and exports: every one beside the manifest is read, and compared with what is now."""

from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path

from rarms_iac.app.errors import Outcome, UseCaseError
from rarms_iac.app.manifests import load_manifest
from rarms_iac.app.report_measurements import LogBesideManifest, report_of
from rarms_iac.app.report_model import ComponentProof, Report
from rarms_iac.app.requests import ManifestSource
from rarms_iac.cli.candidates import unpredicted_nodes
from rarms_iac.cli.datalogs import (
    bench_now,
    compared,
    is_here,
    measurements_of,
    path_of,
    subject_of,
)
from rarms_iac.cli.experiments import refuse_unknown
from rarms_iac.cli.standing import standings_of
from rarms_iac.cli.terminal import Terminal
from rarms_iac.cli.tuning_log import tunings_of
from rarms_iac.measuring.setup import interference_of
from rarms_iac.model.diagnostics import Diagnostic, Finding, Severity
from rarms_iac.model.indexes import find_index
from rarms_iac.model.system import Host, System
from rarms_iac.planner.combining.candidates import Node
from rarms_iac.planner.findings import UNREADABLE
from rarms_iac.storage.datalog.configuration import Proven, ProvenIndex, read_entries
from rarms_iac.storage.datalog.files import FOLDER, LogUnreadable, configuration_path, read_log
from rarms_iac.storage.datalog.identity import Files
from rarms_iac.storage.datalog.log import DataLog

NOTHING_MEASURED = Finding(code="RARMS290", severity=Severity.ERROR, summary="There is nothing to report")


def reported(source: ManifestSource, components: tuple[str, ...] = ()) -> Report:
    """What the data logs beside the manifest show, of these components only or of all.

    Raises:
        click.UsageError: a name is not in the manifest.
        UseCaseError: the manifest has errors, a log cannot be read, or there is none (4).
    """
    manifest = load_manifest(source)
    system = manifest.system
    refuse_unknown(components, system.components, "component")
    folder = Path(manifest.folder)
    logs = tuple(_logged(system, folder))
    if components:
        logs = tuple(log for log in logs if set(log.log.header.setup.members) & set(components))
    report = replace(
        report_of(system, logs, tuple(_proofs(system, folder, components)), standings_of(manifest)),
        tunings=tuple(tunings_of(system, folder)),
    )
    if not report.measurements:
        raise UseCaseError(Outcome.NEGATIVE, [_nothing(components)])
    return report


def candidates_for(source: ManifestSource) -> tuple[Node, ...]:
    """Return the candidate graph for the page; nothing where a reservation is not known yet."""
    manifest = load_manifest(source)
    system = manifest.system
    try:
        return unpredicted_nodes(measurements_of(system, manifest.folder, source), manifest)
    except UseCaseError:
        return ()


def _nothing(components: tuple[str, ...]) -> Diagnostic:
    of = f" of {', '.join(components)}" if components else ""
    says = f"Below {FOLDER}/ beside the manifest there is no data log{of}."
    return NOTHING_MEASURED.at(
        None, says, f"Measure first: `rarms measure{''.join(f' {component}' for component in components)}`."
    )


def _logged(system: System, folder: Path) -> Iterator[LogBesideManifest]:
    """Every log of a platform of the manifest, by path."""
    hosts = {host.platform: host for host in reversed(list(system.hosts.values()))}
    files = Files(folder)
    for path in sorted((folder / FOLDER).glob("*/*/*.jsonl")):
        log = _read(path)
        if log is not None and log.header.platform in hosts and _is_of(system, log):
            yield _beside(system, folder, path, log, hosts[log.header.platform], files)


def _is_of(system: System, log: DataLog) -> bool:
    setup = log.header.setup
    return set(setup.members) <= system.components.keys() and setup.interference in system.interference


def _beside(system: System, folder: Path, path: Path, log: DataLog, host: Host, files: Files) -> LogBesideManifest:
    setup = log.header.setup
    asked = path_of(folder, subject_of(system, host, setup.members, interference_of(system, setup.members)))
    subject = subject_of(system, host, setup.members, setup.interference)
    comparison = compared(log, subject, files, bench_now(host), here=is_here(host))
    return LogBesideManifest(
        path=path.relative_to(folder).as_posix(),
        log=log,
        asked=path == asked,
        stale=tuple(map(str, comparison.changed)),
    )


def _proofs(system: System, folder: Path, components: tuple[str, ...]) -> Iterator[ComponentProof]:
    """What each component showed when all ran together last, on every platform where they did."""
    for platform in sorted({host.platform for host in system.hosts.values()}):
        for name in sorted(components or system.components):
            for entry in _entries(configuration_path(folder, platform, name))[-1:]:
                said = f"{entry.when}, on {entry.host} at {entry.reserve} %"
                yield from (_proof(entry, index, said) for index in entry.indexes)


def _entries(path: Path) -> list[Proven]:
    try:
        return [entry for entry in read_entries(path) if isinstance(entry, Proven)]
    except LogUnreadable as problem:
        raise _unreadable(path, problem) from None


def _proof(entry: Proven, one: ProvenIndex, said: str) -> ComponentProof:
    index = find_index(one.index)
    assert index is not None, "only indexes that there are were proven"
    return ComponentProof(
        component=entry.component,
        index=index,
        threshold=one.threshold,
        value=one.value,
        lower=one.lower,
        upper=one.upper,
        met=one.met,
        verdict=one.verdict or ("met" if one.met else "missed"),
        error=one.error,
        note=said,
    )


def _read(path: Path) -> DataLog | None:
    try:
        return read_log(path)
    except LogUnreadable as problem:
        raise _unreadable(path, problem) from None


def _unreadable(path: Path, problem: LogUnreadable) -> UseCaseError:
    says = f"{path.as_posix()}, line {problem.line}: {problem.says}."
    advice = "Bring it back from git, or remove it and measure again."
    return UseCaseError(Outcome.NEGATIVE, [UNREADABLE.at(None, says, advice)])


def speaks_ascii_only(terminal: Terminal) -> bool:
    """Whether lines and dots beyond ASCII would be escapes there."""
    try:
        "\u2812\u2500\u25cf\u2591".encode(terminal.out.encoding or "utf-8")
    except (LookupError, UnicodeEncodeError):
        return True
    return False
