"""Reports and exports: every data log next to the manifest is read, and compared with what is now."""

from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import replace
from pathlib import Path

from rarms_iac.app.data_logs import files_of, known_platform, present, subject_of, used_processors
from rarms_iac.app.decision_logs import tunings_of
from rarms_iac.app.declared_hosts import totals_at_hand
from rarms_iac.app.drift import ComparedHost, drift_of_hosts
from rarms_iac.app.graph import candidate_graph
from rarms_iac.app.hosts import Hosts, last_runs, observe_host, select_hosts
from rarms_iac.app.manifests import Manifest
from rarms_iac.app.measurement_files import log_errors
from rarms_iac.app.planning import plan_request, with_reservations
from rarms_iac.app.report_measurements import ReportedLog, report_of
from rarms_iac.app.report_model import ComponentProof, Report
from rarms_iac.app.requests import HostSelection, refuse_unknown
from rarms_iac.app.use_case_errors import Outcome, UseCaseError
from rarms_iac.model.commands import command, prose
from rarms_iac.model.diagnostics import Diagnostic, has_errors, in_order
from rarms_iac.model.experiment import experiment_of
from rarms_iac.model.host import ProviderKind
from rarms_iac.model.indexes import index_named
from rarms_iac.model.journal import RunKind, history_of
from rarms_iac.model.layout import PlacedPartition
from rarms_iac.model.seen_host import seen_hosts
from rarms_iac.model.setting import EnvironmentSetup
from rarms_iac.model.system import System
from rarms_iac.planner.combining.candidates import Node
from rarms_iac.planner.groups import groups_of
from rarms_iac.planner.planning_findings import ON_NEIGHBOURS
from rarms_iac.planner.reservations import ReservationSource, names_of
from rarms_iac.planner.sizes import size
from rarms_iac.storage.datalog.decisions import Proven, ProvenIndex, read_entries
from rarms_iac.storage.datalog.files import configuration_path, read_log
from rarms_iac.storage.datalog.log import Header, LogFile
from rarms_iac.storage.datalog.named_files import Files
from rarms_iac.storage.disk import MEASUREMENTS
from rarms_iac.texts.findings import NOT_DONE, first_of_each_kind
from rarms_iac.texts.indexes import show_threshold
from rarms_iac.texts.messages import in_a_row, natural_order
from rarms_iac.texts.quantities import show_percent, show_reserve


def report_of_manifest(manifest: Manifest, components: Sequence[str] = (), *, with_candidates: bool = False) -> Report:
    """Read what the data logs next to a manifest show.

    Args:
        manifest: The logs lie below its folder, and are compared with what it says now.
        components: Only logs with any of these; none: all.

    Returns:
        Every log as the planner looks it up, with stale ones marked, and the totals of each platform in LPs.

    Raises:
        RequestError: A name is not in the manifest.
        UseCaseError: A log cannot be read, or there is none (negative).
    """
    logs = _logs_of(manifest, components)  # as long as they are in use, nothing below reads them again
    report = _report(manifest, components, logs, with_candidates=with_candidates)
    if not report.measurements:
        raise UseCaseError(Outcome.NEGATIVE, [_nothing(components)])
    hosts, problems = _compared_hosts(manifest)
    with_runs = [host for host in hosts if host.own_runs]  # a checkout has no host's state
    proofs = compared_with_hosts(report.proofs, with_runs)
    findings = not_yet_proven((*manifest.findings, *problems), proofs)
    return replace(
        report,
        proofs=proofs,
        hosts=hosts,
        is_planned=not has_errors(problems),
        findings=first_of_each_kind(in_order(findings)),
    )


def not_yet_proven(findings: Iterable[Diagnostic], proofs: Sequence[ComponentProof]) -> tuple[Diagnostic, ...]:
    """Leave out the notes that a threshold depends on its neighbours where a proof of this layout showed that it holds.

    Args:
        proofs: the last ones of its components.

    Returns:
        The findings, in the same order. A note stays where a threshold of it was not proven under a load, or a
            proof of it did not hold or is outdated.
    """
    held: dict[tuple[str, str], bool] = {}
    for proof in proofs:
        if proof.entry.interference is not None or not proof.proven.met:
            key = (proof.entry.component, proof.index.name)
            held[key] = held.get(key, True) and proof.proven.met and not proof.outdated
    return tuple(finding for finding in findings if not _is_proven(finding, held))


def _is_proven(finding: Diagnostic, held: Mapping[tuple[str, str], bool]) -> bool:
    if finding.code != ON_NEIGHBOURS.code:
        return False
    component, indexes = finding.values["component"], finding.values["indexes"]
    return isinstance(indexes, tuple) and all(held.get((str(component), str(index)), False) for index in indexes)


def measured_report(manifest: Manifest, *, with_candidates: bool = False) -> Report:
    """Read the same of the logs alone, of which there may be none: no layout is made.

    Args:
        with_candidates: Whether the report has the nodes of the candidate graph, parts before the compounds that
            consist of them; without predictions, and none where a reservation is not known yet.

    Returns:
        The report without the hosts and without findings.

    Raises:
        UseCaseError: A log cannot be read (negative).
    """
    return _report(manifest, (), _logs_of(manifest, ()), with_candidates=with_candidates)


def _report(
    manifest: Manifest, components: Sequence[str], logs: Sequence[ReportedLog], *, with_candidates: bool
) -> Report:
    planned, reservations = totals_at_hand(manifest)
    proofs = tuple(_proofs(manifest, components, reservations))
    report = report_of(manifest.system, logs, proofs, planned, reservations)
    asked = (each for each in report.verdicts if not components or each.component in components)
    return replace(
        report,
        verdicts=tuple(asked),
        tunings=tuple(tunings_of(manifest)),
        candidates=_candidates(manifest) if with_candidates else (),
    )


def _candidates(manifest: Manifest) -> tuple[Node, ...]:
    try:
        return candidate_graph(manifest, predict=False).candidates
    except UseCaseError:
        return ()


def _nothing(components: Sequence[str]) -> Diagnostic:
    of = f" of {', '.join(components)}" if components else ""
    return NOT_DONE.at(
        None,
        "{measurements}/ next to the manifest has no data log{of}.",
        prose("Measure first: ", command("measure", *components), "."),
        components=tuple(components),
        measurements=MEASUREMENTS,
        of=of,
    )


def _logs_of(manifest: Manifest, components: Sequence[str]) -> tuple[ReportedLog, ...]:
    refuse_unknown(components, manifest.system.components, "component")
    logs = tuple(_read_logs(manifest.system, files_of(manifest)))
    return tuple(log for log in logs if not components or set(log.log.header.setup.members) & set(components))


def _read_logs(system: System, files: Files) -> Iterator[ReportedLog]:
    """Read each log of a platform of the manifest, by path."""
    platforms = {host.platform for host in system.hosts.values()}
    for path in sorted((files.folder / MEASUREMENTS).glob("*/*/*.jsonl")):
        with log_errors():
            file = read_log(path)
        if file is None:
            continue
        *_, last = file.headers.values()
        if last.platform in platforms and _is_of(system, last.setup):
            yield _reported_log(system, files, path, file, last)


def _is_of(system: System, setup: EnvironmentSetup) -> bool:
    return set(setup.members) <= system.components.keys() and setup.interference in system.interference


def _reported_log(system: System, files: Files, path: Path, file: LogFile, last: Header) -> ReportedLog:
    setup = last.setup
    host = next(host for host in system.hosts.values() if host.platform == last.platform)
    subject = subject_of(system, host, setup.members, setup.interference)
    platform_facts = known_platform(host)
    found = present(file, subject, files, platform_facts)
    log = found.log or file.log_of(last, [last.digest])
    used = used_processors(system, host, files, platform_facts)
    number = experiment_of(system, host, setup.members, setup.interference, used=used).setup.processors
    return ReportedLog(
        path=path.relative_to(files.folder).as_posix(),
        log=log.of(number),
        is_expected=setup.interference in system.loads_of(setup.members),
        stale=tuple(map(str, found.comparison.changed)),
        others=found.others,
    )


def _proofs(manifest: Manifest, components: Sequence[str], reservations: ReservationSource) -> Iterator[ComponentProof]:
    """Yield the proofs of components in the applied layout; of each host the last under each load."""
    system, folder = manifest.system, manifest.folder
    for platform in sorted({host.platform for host in system.hosts.values()}):
        for name in sorted(components or system.components, key=natural_order):
            with log_errors():
                entries = list(read_entries(configuration_path(folder, platform, name)))
            own = [entry for entry in entries if isinstance(entry, Proven) and entry.component == name]
            for entry in _standing(own):
                layout = tuple(_layout_since(entry, system, reservations))
                for index in entry.indexes:
                    changed = (*_threshold_since(entry, index, system), *layout)
                    yield ComponentProof(entry=entry, proven=index, outdated=changed)


def _standing(entries: Sequence[Proven]) -> list[Proven]:
    """Return the last entry of each load, on each machine."""
    machines = sorted({entry.machine for entry in entries})
    return [own for machine in machines for own in _standing_of([each for each in entries if each.machine == machine])]


def _standing_of(entries: Sequence[Proven]) -> list[Proven]:
    """Select the proofs that count on one machine; one without load counts until a proof under load follows."""
    last = {entry.interference: at for at, entry in enumerate(entries)}
    without = last.pop(None, -1)
    numbers = [*last.values(), *([without] if without > max(last.values(), default=-1) else [])]
    return [entries[number] for number in sorted(numbers)]


def _threshold_since(entry: Proven, proven: ProvenIndex, system: System) -> Iterator[str]:
    """Describe the difference between the threshold now and the proven one."""
    now = system.components[entry.component].apt.get(proven.index)
    if now is None:
        yield "this threshold was removed"
    elif now != proven.threshold:
        yield f"the threshold is {show_threshold(index_named(proven.index), now)} now"


def _layout_since(entry: Proven, system: System, reservations: ReservationSource) -> Iterator[str]:
    """Describe the difference between the layout now and the proven one."""
    host = system.hosts.get(entry.host)
    if host is None:
        yield f"the host {entry.host} was removed"
        return
    gone = sorted(set(entry.beside) - system.components.keys(), key=natural_order)
    new = sorted(system.components.keys() - {*entry.beside, entry.component}) if len(system.hosts) == 1 else []
    if gone or new:
        yield " and ".join([f"{name} is gone" for name in gone] + [f"{name} is new" for name in new])
    group = next((group for group in groups_of(system) if entry.component in names_of(group.members)), None)
    if group is None or not entry.partition:
        return
    if group.name != entry.partition:
        yield f"its partition is {group.name} now"
    partition = size(group, host, reservations)
    if not isinstance(partition, PlacedPartition):
        yield "its reservation is not known now"
    elif partition.settings.reserve != entry.reserve:
        yield f"its partition reserves {show_reserve(partition.settings.reserve, partition.settings.processors)} now"


_Looked = tuple[tuple[ComparedHost, ...], tuple[Diagnostic, ...]]


def _compared_hosts(manifest: Manifest) -> _Looked:
    """Compare the simulated hosts, and find why there is no layout."""
    # NOTE: a report needs no host, and waits for none: others are not asked.
    hosts = manifest.system.hosts
    names = tuple(sorted(name for name, host in hosts.items() if host.provider is ProviderKind.SIMULATED))
    if not names:
        return (), ()
    try:
        return _compared(select_hosts(manifest, HostSelection(hosts=names)))
    except UseCaseError:  # a host's file is damaged, or held: every command that is about hosts says so
        return (), ()


def _compared(hosts: Hosts) -> _Looked:
    states = {name: observe_host(hosts.open(name)) for name in hosts.chosen}
    request = replace(with_reservations(hosts, plan_request(hosts), states), explain=False)
    runs = dict(last_runs(hosts))
    drifts, problems = drift_of_hosts(request, states, runs)
    seen = seen_hosts(hosts.system.hosts, hosts.system.application.name, states)
    compared = (
        ComparedHost(seen=seen[name], drifted=drifts.get(name, ()), runs=history_of(runs.get(name)))
        for name in hosts.chosen
    )
    return tuple(compared), problems


def compared_with_hosts(proofs: Sequence[ComponentProof], hosts: Sequence[ComparedHost]) -> tuple[ComponentProof, ...]:
    """Leave out the proofs of other machines, and say of each other one why the host no longer has its layout.

    Robots share the names of hosts, and the log: a proof that another machine gave says nothing of this one.

    Args:
        hosts: those that were looked at; the proofs of other hosts stay as they are.
    """
    by_name = {host.name: host for host in hosts}
    machines = {host.name: host.seen.facts.id for host in hosts if host.seen.facts.id}
    own = (
        proof
        for proof in proofs
        if not proof.entry.machine or machines.get(proof.entry.host) in {None, proof.entry.machine}
    )
    return tuple(
        replace(proof, outdated=(*proof.outdated, *_changes_since(proof, by_name[proof.entry.host])))
        if proof.entry.host in by_name
        else proof
        for proof in own
    )


def _changes_since(proof: ComponentProof, host: ComparedHost) -> Iterator[str]:
    if undone_at := host.undone_at(proof.entry.serial):
        yield f"its layout on {host.name} was undone at {undone_at}"
        return
    foreign = f"was changed on {host.name} by another tool after {host.last_run_at}"
    if host.own_runs and host.own_runs[-1].run is RunKind.UNDO:  # it may have set again what another tool had set
        foreign = f"was changed on {host.name} by the undo at {host.last_run_at} or by another tool after it"
    if proof.entry.partition in host.changed_partitions:
        yield f"its partition {foreign}"
    differences = _differences(proof, host)
    others = host.changed_partitions - {proof.entry.partition}
    neighbours = [text for name, text in differences.items() if name in others]
    by_runs = [text for name, text in differences.items() if name not in host.changed_partitions]
    if neighbours:
        yield f"its layout {foreign}: {in_a_row(neighbours)}"
    if by_runs:
        when = f" at {host.last_run_at}" if host.serial > proof.entry.serial else ""
        yield f"its layout on {host.name} was changed{when}: {in_a_row(by_runs)}"


def _differences(proof: ComponentProof, host: ComparedHost) -> Mapping[str, str]:
    """Return the change of each partition's reservation since the proof, by partition."""
    own = {proof.entry.partition: proof.entry.reserve} if proof.entry.partition else {}
    then, now = proof.entry.layout or own, host.reserves
    compared = {*then, *now} if proof.entry.layout else {*then}
    return {
        name: _difference(name, then.get(name), now.get(name))
        for name in sorted(compared, key=natural_order)
        if then.get(name) != now.get(name)
    }


def _difference(name: str, then: int | None, now: int | None) -> str:
    if now is None:
        return f"{name} is gone"
    if then is None:
        return f"{name} is new"
    return f"{name} has {show_percent(now)} of its VPs instead of {show_percent(then)}"
