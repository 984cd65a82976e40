"""Data logs for planning: finds and reads them, compares them with the present, and turns them into reservations.

Here and nowhere else files of measurements become values for the planner, which reads none.
"""

from collections.abc import Callable, Hashable, Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from fractions import Fraction
from functools import cache
from pathlib import Path

from rarms_iac.app.manifests import Manifest
from rarms_iac.app.measurement_files import unreadable_advice
from rarms_iac.manifest.checks.measurement import advice_on_weak_loads
from rarms_iac.model.commands import Prose, RecommendedCommand, Wording, command, prose
from rarms_iac.model.diagnostics import Diagnostic
from rarms_iac.model.experiment import ProcessorNumber, Used, experiment_of, processor_number
from rarms_iac.model.host import Host, HypervHost, ProviderKind
from rarms_iac.model.loads import BUSY_LOOP, could_take_all
from rarms_iac.model.outcomes import UncertainEstimate
from rarms_iac.model.quantities import ReservePercent, guaranteed
from rarms_iac.model.setting import SHORT, Setting, most_used
from rarms_iac.model.state import HostFacts, State
from rarms_iac.model.system import Component, PartitionRequest, System, run_of
from rarms_iac.planner import planning_findings
from rarms_iac.planner.groups import Group, groups_of
from rarms_iac.planner.planning_findings import NOT_VERIFIED
from rarms_iac.planner.reservations import MeasuredReservations, depends_on_a_log, names_of, to_be_measured
from rarms_iac.planner.verdicts import LogOfLoad, MeasuredTogether, Names, NotMeasured, not_measured, with_curves
from rarms_iac.statistics.curves import Curve, curve_of, highest_missed, least_reserve
from rarms_iac.statistics.first_look import least_estimated, uncertain_estimates
from rarms_iac.storage.datalog.files import LogUnreadable, log_path, read_log
from rarms_iac.storage.datalog.identity import (
    ATTACHED_CONFINEMENT,
    CONFINEMENT,
    GROUP_CONFINEMENT,
    Changed,
    LogSubject,
    ObservedPlatform,
    PartialPlatform,
    Present,
    identity_of,
    present_log,
)
from rarms_iac.storage.datalog.log import DataLog, LogFile, Recorded
from rarms_iac.storage.datalog.named_files import MOST_BYTES, Files
from rarms_iac.texts.findings import DIFFERENT, Finding, Given
from rarms_iac.texts.messages import in_a_row

LISTED = 4
"""Changes that one message names; more are counted."""


def subject_of(
    system: System, host: Host, members: tuple[str, ...], interference: str, parts: int | None = None
) -> LogSubject:
    """Return the subject of a data log of these components.

    Args:
        members: Names of the components that share P1, sorted.
        interference: Name of the load in P2.
        parts: Of P2; None: as many as the load usually has there.

    Returns:
        The members by sorted names, with all that a log of them depends on.
    """
    experiment = experiment_of(system, host, members, interference)
    return LogSubject(
        platform=host.platform,
        components=experiment.members,
        setup=experiment.setup,
        load=experiment.load,
        tasks=system.tasks,
        confinement=_confinement(host, experiment.members),
        load_parts=parts or experiment.usual_load_parts,
        fixes_processors=experiment.fixes_processors,
    )


def _confinement(host: Host, members: Iterable[Component]) -> str:
    if host.provider is not ProviderKind.LINUX:
        return CONFINEMENT
    is_attached = any(member.run is not None and member.run.attach is not None for member in members)
    return ATTACHED_CONFINEMENT if is_attached else GROUP_CONFINEMENT


def path_of(folder: Path, subject: LogSubject) -> Path:
    """Return the path of a subject's data log.

    Args:
        subject: Its platform, members and load name the file.

    Returns:
        A path below `measurements/` of the folder; the file need not exist.
    """
    return log_path(folder, subject.platform, subject.setup.members, subject.setup.interference)


def files_of(manifest: Manifest, most_bytes: int | None = MOST_BYTES) -> Files:
    """Return the files that the components and loads of a manifest name.

    Args:
        manifest: The manifest, which has the folder of its logs and that of its components' files.
    """
    return Files(manifest.folder, most_bytes=most_bytes, code=manifest.code_folder)


def why_outdated(manifest: Manifest, host: Host, members: Names) -> str:
    """Tell why what was once measured of these components together does not hold any more.

    Args:
        manifest: The manifest, next to which its logs lie.
        host: On which they were to be together.
        members: Names of components, sorted; the manifest may know some no longer.

    Returns:
        A clause without a full stop; empty: their data log holds as it is.
    """
    system, files = manifest.system, files_of(manifest)
    if gone := [name for name in members if name not in system.components]:
        return f"{', '.join(gone)} was removed from the manifest"
    reasons = (
        _why_log_outdated(subject_of(system, host, members, load), files, host) for load in system.loads_of(members)
    )
    return next(filter(None, reasons), "")


def _why_log_outdated(subject: LogSubject, files: Files, host: Host) -> str:
    try:
        file = read_log(path_of(files.folder, subject))
    except LogUnreadable:
        return "its data log is damaged"
    if file is None:
        return "its data log does not exist"
    return "; ".join(map(str, present(file, subject, files, known_platform(host)).comparison.changed))


def used_processors(
    system: System, host: Host, files: Files, platform_facts: ObservedPlatform, read: "_ReadLog | None" = None
) -> Used:
    """Return the processors that components use at once on a host by their data logs.

    Args:
        host: Logs of its platform count, under any load of the manifest.
        platform_facts: The host as it is now: a log that no longer holds says nothing.
        read: Reads a log; None: each is read when it is asked for.

    Returns:
        A function from sorted names of components to the most that they were seen to use together; each is looked
        up once.
    """

    @cache
    def used(members: Names) -> int | None:
        settings: list[Setting] = []
        for load in system.interference:
            path = log_path(files.folder, host.platform, members, load)
            file = (read or _read)(path) if path.exists() else None
            if isinstance(file, LogFile):
                subject = subject_of(system, host, members, load)
                log = present(file, subject, files, platform_facts).log
                settings += () if log is None else (recorded.setting for recorded in log.recorded)
        return most_used(settings)

    return used


def logs_of(manifest: Manifest, host: Host, members: Names) -> tuple[Path, ...]:
    """List the paths of the data logs that decide a reservation of these components together.

    Args:
        manifest: The manifest, next to which its logs lie.
        host: On which they are to be together.
        members: Names of components of the manifest, sorted.

    Returns:
        A path for each load under which it must hold; the files need not exist.
    """
    loads = manifest.system.loads_of(members)
    return tuple(log_path(manifest.folder, host.platform, members, load) for load in loads)


def measured_reservations(manifest: Manifest, states: Mapping[str, State]) -> MeasuredReservations:
    """Read what the data logs say on every host of the manifest.

    Args:
        manifest: The manifest, next to which its logs lie.
        states: What hosts look like, by name; of those that were looked at, that is compared with the logs, too.

    Returns:
        Reservations for the planner. A log that is missing, damaged or stale is an answer, not an error.
    """
    system, folder = manifest.system, _LogFolder(files=files_of(manifest), read=cache(_read))
    kinds = {name: _kind_of(host, states) for name, host in sorted(system.hosts.items())}
    hosts_by_kind: dict[_Kind, list[str]] = {}
    for name, kind in kinds.items():
        hosts_by_kind.setdefault(kind, []).append(name)
    logs: dict[tuple[Hashable, Names], tuple[LogOfLoad, ...]] = {}
    for group in filter(depends_on_a_log, groups_of(system)):
        if not system.loads_of(names_of(group.members)):
            continue  # the manifest has none of those that it names
        for kind, names in hosts_by_kind.items():
            if any(map(group.may_run_on, names)):
                host = system.hosts[names[0]]
                logs[kind, names_of(group.members)] = _log_of_each_load(
                    system, folder, group, host, kind.platform_facts
                )

    def missed_together(names: Names, host: Host) -> Fraction:
        """Return the most LPs with which these were shown to miss a threshold together.

        The number is 0 where they were not measured together.
        """
        if not all(path.is_file() for path in logs_of(manifest, host, names)):
            return Fraction(0)
        together, group = put_together(system, names)
        found = _log_of_each_load(together, folder, group, host, kinds[host.name].platform_facts)
        logs_together = [log for log in found if isinstance(log, MeasuredTogether)]
        if len(logs_together) < len(found):
            return Fraction(0)
        missed = (
            guaranteed(highest_missed(with_curves(group.members, log.curves)), log.processors) for log in logs_together
        )
        return max(missed, default=Fraction(0))

    return MeasuredReservations(kinds=kinds, logs=logs, missed_together=missed_together)


def put_together(system: System, names: Names) -> tuple[System, Group]:
    """Put components into one partition, as those of a compound are measured.

    Returns:
        The manifest with that partition, called after the first of them, instead of those that they were in; and it.
    """
    others = {name: request for name, request in system.partitions.items() if not set(request.components) & set(names)}
    shared = PartitionRequest(name=names[0], components=names)
    together = replace(system, partitions={**others, names[0]: shared})
    return together, next(group for group in groups_of(together) if names_of(group.members) == names)


def present(file: LogFile, subject: LogSubject, files: Files, platform_facts: ObservedPlatform) -> Present:
    """Select what of a data log holds now.

    NOTE: interpreters outside of the folder are recorded by a measurement and not looked for here: nothing but files
    below the folder is opened for an untrusted manifest.

    Returns:
        Of a load that usually runs in several parts, what was measured with fewer where nothing of more holds: a sweep,
        the paper's strategy, or a host without memory for the others.
    """

    def found(parts: int) -> Present:
        identity = identity_of(replace(subject, load_parts=parts), files.of(subject), {})
        return present_log(file, subject.setup.members, identity, platform_facts)

    tried: list[Present] = []
    for parts in range(subject.load_parts, 0, -1):
        tried.append(found(parts))
        if tried[-1].log is not None:
            return tried[-1]
    return min(tried, key=lambda each: len(each.comparison.changed))


def known_platform(host: Host, facts: HostFacts | None = None) -> PartialPlatform:
    """Return the facts of a host that are known now, for a comparison with those of a data log.

    Args:
        facts: As it was seen; None: it was not looked at.

    Returns:
        Provider, LPs and image as the manifest has them; SMT, scheduler and OS build as seen; the rest is left open.
    """
    image = host.settings.image or "" if isinstance(host.settings, HypervHost) else None
    platform_facts = PartialPlatform(
        provider=host.provider, logical_processors=host.logical_processors, guest_image=image
    )
    if facts is None:
        return platform_facts
    return replace(platform_facts, smt=facts.smt, scheduler=facts.scheduler, os_build=facts.os_build)


@dataclass(frozen=True, slots=True, kw_only=True)
class _Kind:
    """A kind of host: the same data logs hold for all hosts of one kind."""

    platform: str
    platform_facts: PartialPlatform


_ReadLog = Callable[[Path], LogFile | LogUnreadable | None]


@dataclass(frozen=True, slots=True, kw_only=True)
class _LogFolder:
    """A manifest's folder, of which each file and each log is read once."""

    files: Files
    read: _ReadLog


def _log_of_each_load(
    system: System, folder: _LogFolder, group: Group, host: Host, platform_facts: PartialPlatform
) -> tuple[LogOfLoad, ...]:
    """Return the log of each load, or the reason why it does not count, in the order of the loads."""
    members = names_of(group.members)
    anywhere = replace(platform_facts, guest_image=None)  # a partition may have an image of its own
    used = used_processors(system, host, folder.files, anywhere, folder.read)
    number = processor_number(group.members, group.request.processors, host.logical_processors, used)
    described = [system.interference[load] for load in system.loads_of(members)]
    subjects = [subject_of(system, host, members, load) for load in system.loads_of(members)]
    found = tuple(_measured_together(subject, folder, group, platform_facts, number) for subject in subjects)
    weak = [log for log in found if isinstance(log, MeasuredTogether) and log.weak]
    if len(weak) == len(found) and any(could_take_all(load, host.logical_processors) for load in described):
        remark = _left_idle(system, group, host, weak)
        return (replace(weak[0], remarks=(*weak[0].remarks, remark)), *weak[1:])
    return found


def _left_idle(system: System, group: Group, host: Host, logs: Sequence[MeasuredTogether]) -> Diagnostic:
    """Return the remark that the loads left much of the host idle.

    NOTE: of a load that cannot take all by its nature RARMS325 reports it, from the manifest; so this does not.
    """
    names = names_of(group.members)
    loads = system.loads_of(names)
    measure = command("measure", interference=BUSY_LOOP, again=BUSY_LOOP in loads)
    return DIFFERENT.at(
        None,
        (
            "{logs:all}: the load left more than {_short:%} of the processors idle. Under a full load the "
            "components may need more."
        ),
        advice_on_weak_loads(system, host, names, loads, measure),
        address=_address(group),
        logs=tuple(log.path for log in logs),
        _short=round(100 * SHORT),
    )


def _address(group: Group) -> str:
    return f"component/{to_be_measured(group.members)[0]}"


def _measured_together(
    subject: LogSubject, folder: _LogFolder, group: Group, platform_facts: PartialPlatform, number: ProcessorNumber
) -> LogOfLoad:
    path = path_of(folder.files.folder, subject).relative_to(folder.files.folder).as_posix()
    own = group.request.hyperv.image
    now = replace(platform_facts, guest_image=own) if own is not None else platform_facts
    found = _log_that_holds(subject, folder, group, now, path)
    if isinstance(found, NotMeasured):
        return found
    assert found.log is not None, "else it is stale"
    log = found.log.of(number.number)
    curves = curves_in(log, {member.name: member for member in group.members})
    is_shown = least_reserve(with_curves(group.members, curves)) is not None
    used = log.counting if is_shown else log.estimating  # the settings of the first pass count until then
    return MeasuredTogether(
        path=path,
        interference=subject.setup.interference,
        processors=number.number,
        processors_from=number.source,
        measured=tuple(sorted({setting.reserve for setting in log.settings})),
        estimated=_estimated(log, group),
        uncertain_at=lambda reserve: _uncertain(log, group, reserve),
        looks=sum(record.setting.first_pass for record in log.recorded),
        curves=curves,
        records=log,
        used_records=used,
        others=found.others,
        remarks=tuple(_remarks(used, found, group, path, folder.files.cut)),
        again=_measuring(names_of(group.members)),
        weak=any(recorded.provenance.weak_load for recorded in used),
        cpu_ms=_cpu_ms_in(log.settings or log.estimated),
        used=most_used(recorded.setting for recorded in found.log.recorded),
    )


def _estimated(log: DataLog, group: Group) -> ReservePercent | None:
    """Return the least CR that is enough by estimates; None without a setting of the first pass."""
    if not any(record.setting.first_pass for record in log.recorded):
        return None
    runs = {member.name: run_of(member) for member in group.members}
    return least_estimated(log.estimated, runs, {member.name: member.apt for member in group.members})


def _uncertain(log: DataLog, group: Group, reserve: ReservePercent) -> tuple[UncertainEstimate, ...]:
    """Return the estimates at a reservation that more samples may change most."""
    runs = {member.name: run_of(member) for member in group.members}
    apts = {member.name: member.apt for member in group.members}
    at = [setting for setting in log.estimated if setting.reserve == reserve]
    return tuple(each for setting in at for each in uncertain_estimates(setting.series, runs, apts))


def _log_that_holds(
    subject: LogSubject, folder: _LogFolder, group: Group, platform_facts: PartialPlatform, path: str
) -> Present | NotMeasured:
    """Read a data log, and return why it does not count if it is missing, unreadable or stale.

    Args:
        path: of the log, as messages name it.
    """
    members = names_of(group.members)
    again = _measuring(members)
    load = subject.setup.interference

    def without_answer(finding: Finding, template: str, advice: Wording, **facts: Given) -> NotMeasured:
        names = to_be_measured(group.members)
        return not_measured(finding, names, subject.platform, template, advice, load=load, log=path, **facts)

    file = folder.read(path_of(folder.files.folder, subject))
    if file is None:
        return without_answer(
            planning_findings.UNMEASURED,
            "{_members} not measured on {platform} with {_load} yet ({log}).",
            prose("Measure first: ", again, ". Or set a fixed reserve (`cpu.reserve`)."),
            _members=f"{in_a_row(members)} {'is' if len(members) == 1 else 'are'}",
            _load=load,
        )
    if isinstance(file, LogUnreadable):
        advice = unreadable_advice(file, prose("remove it and measure again: ", again))
        template = "{log}, line {line}: {reason}."
        return without_answer(planning_findings.UNREADABLE, template, advice, line=file.line, reason=file.message)
    found = present(file, subject, folder.files, platform_facts)
    if found.log is None:
        changed = found.comparison.changed
        return without_answer(
            planning_findings.STALE,
            "{log} is no longer valid. Changed since the measurement: {_changed}.",
            stale_advice(changed, members),
            changed=tuple(map(str, changed)),
            _changed=_list_some(changed),
        )
    return found


def stale_advice(changed: Sequence[Changed], members: Names) -> Prose:
    """Say what to do about a data log that no longer holds.

    Args:
        changed: What is not as it was.
    """
    again = _measuring(members)
    if not any(change.is_of_hardware for change in changed):
        return prose("Measure again: ", again, ". Or undo the change.")
    if any(change.part == "provider" and ProviderKind.SIMULATED in {change.before, change.after} for change in changed):
        return prose(
            "Measurements on a simulated host are never valid for a real one. Measure on this host: ",
            again.also(again=True),
            ". Or set a fixed reserve (`cpu.reserve`). To separate the data logs, write `platform: NAME` in the "
            "overlay of the simulated host.",
        )
    return prose(
        (
            "If this is another machine, give the host another platform: `platform: NAME`. If this "
            "machine was changed, measure again: "
        ),
        again.also(again=True),
        ".",
    )


def _measuring(members: Names) -> RecommendedCommand:
    return command("measure", *members, together=len(members) > 1)


def curves_in(log: DataLog, components: Mapping[str, Component]) -> Callable[[str, str], Curve]:
    """Return the curves of a data log.

    Args:
        components: Of the log, by name, as the manifest has them.

    Returns:
        A function from component and index to its curve; each is made when it is first asked for.
    """

    @cache
    def curve(component: str, index: str) -> Curve:
        return curve_of(log.settings, component, index, run_of(components[component]))

    return curve


def _cpu_ms_in(settings: Sequence[Setting]) -> Callable[[str], float | None]:
    """Return the processor time that a job of a component took, over all settings that can tell."""

    @cache
    def cpu_ms_of(component: str) -> float | None:
        recorded = [series for setting in settings for series in setting.series if series.component == component]
        with_cpu_time = [series for series in recorded if series.cpu_ms is not None and series.samples]
        jobs = sum(len(series.samples) for series in with_cpu_time)
        return sum(series.cpu_ms or 0.0 for series in with_cpu_time) / jobs if jobs else None

    return cpu_ms_of


def _remarks(used: Sequence[Recorded], found: Present, group: Group, path: str, cut: str) -> Iterator[Diagnostic]:
    remarks = (*_remarks_on_files(found, cut), *_remarks_on_conditions(used, found, group))
    for finding, template, advice, facts in remarks:
        yield finding.at(None, template, advice, address=_address(group), related=(), log=path, **facts)


_Remark = tuple[Finding, str, Wording, Mapping[str, Given]]
"""A finding on a data log without its place: template, advice and facts."""


def _remarks_on_files(found: Present, cut: str) -> Iterator[_Remark]:
    if unverified := found.comparison.unverified:
        template = (
            "{log} was measured with {_files}. Each of these files is missing here or larger than {_most:bytes}, "
            "so rarms did not compare it."
        )
        advice = "To be sure, plan on a machine that has these files."
        yield NOT_VERIFIED, template, advice, _listed("files", unverified) | {"_most": MOST_BYTES}
    if cut:
        template = "{log}: {reason}. rarms does not notice changes in other files."
        yield (
            NOT_VERIFIED,
            template,
            "List fewer or smaller files in `run.files`, for example one folder.",
            {"reason": cut},
        )


def _remarks_on_conditions(used: Sequence[Recorded], found: Present, group: Group) -> Iterator[_Remark]:
    if differences := tuple(map(str, found.comparison.warns)):
        template = "{log} was measured under different conditions: {_differences}."
        advice = "If this can affect the component, measure again."
        yield DIFFERENT, template, advice, _listed("differences", differences)
    if differences := tuple(map(str, found.other_hardware)):
        template = "{log} was measured on two kinds of hardware ({_differences}). Plans use the later measurements."
        advice = "Give each kind of machine its own platform: write `platform: NAME` at the host."
        yield DIFFERENT, template, advice, _listed("differences", differences)
    if found.others:
        advice = "No action is needed. Plans use these settings again when the conditions are the same."
        yield (
            NOT_VERIFIED,
            "{log} has {settings:setting} that were measured under other conditions.",
            advice,
            {"settings": found.others},
        )
    if running := tuple(sorted({name for recorded in used for name in recorded.provenance.beside})):
        again = _measuring(names_of(group.members)).also(again=True)
        template = "These partitions ran on the host during the measurement of {log}: {_partitions}."
        alone = prose("Measure again while nothing else runs on the host: ", again, ".")
        yield DIFFERENT, template, alone, _listed("partitions", running)


def _listed(name: str, things: tuple[str, ...]) -> dict[str, Given]:
    """Return them as a fact of a finding, and some of them as words for its template."""
    return {name: things, f"_{name}": _list_some(things)}


def _list_some(things: tuple[object, ...]) -> str:
    listed = [str(thing) for thing in things[:LISTED]]
    more = len(things) - len(listed)
    return "; ".join(listed) + (f"; and {more} more" if more else "")


def _kind_of(host: Host, states: Mapping[str, State]) -> _Kind:
    state = states.get(host.name)
    platform_facts = known_platform(host, state.facts if state else None)
    return _Kind(platform=host.platform, platform_facts=platform_facts)


def _read(path: Path) -> LogFile | LogUnreadable | None:
    try:
        return read_log(path)
    except LogUnreadable as problem:
        return problem
