"""Data logs for planning: finds and reads them, compares them with the present, and turns them into reservations.

Here and nowhere else files of measurements become values for the planner, which reads none.
"""

from collections.abc import Callable, Hashable, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from fractions import Fraction
from functools import cache
from pathlib import Path

from rarms_iac.app.manifests import Manifest
from rarms_iac.app.measurement_files import unreadable_advice
from rarms_iac.manifest.checks.measurement import advice_on_weak_loads
from rarms_iac.model.commands import Prose, RecommendedCommand, Wording, command, prose
from rarms_iac.model.diagnostics import DIFFERENT, Diagnostic, Finding, Given
from rarms_iac.model.experiment import ProcessorNumber, Used, experiment_of, processor_number
from rarms_iac.model.host import Host, HypervHost, ProviderKind
from rarms_iac.model.loads import BUSY_LOOP, could_take_all
from rarms_iac.model.quantities import guaranteed
from rarms_iac.model.setting import CONFINEMENT, GROUP_CONFINEMENT, SHORT, Setting, most_used
from rarms_iac.model.state import HostFacts, State
from rarms_iac.model.system import Component, PartitionRequest, System, Threshold, run_of
from rarms_iac.model.wording import in_a_row
from rarms_iac.planner import planning_findings
from rarms_iac.planner.groups import Group, groups_of
from rarms_iac.planner.planning_findings import NOT_VERIFIED
from rarms_iac.planner.reservations import MeasuredReservations, depends_on_a_log, names_of, to_be_measured
from rarms_iac.planner.verdicts import LogOfLoad, MeasuredTogether, Names, NotMeasured, not_measured
from rarms_iac.statistics.curves import Curve, curve_of, highest_missed
from rarms_iac.storage.datalog.files import LogUnreadable, log_path, read_log
from rarms_iac.storage.datalog.identity import (
    Changed,
    LogSubject,
    ObservedPlatform,
    PartialPlatform,
    Present,
    identity_of,
    present_log,
)
from rarms_iac.storage.datalog.log import DataLog, LogFile
from rarms_iac.storage.datalog.named_files import MOST_BYTES, Files

LISTED = 4
"""Changes that one message names; more are counted."""


def subject_of(system: System, host: Host, members: tuple[str, ...], interference: str) -> LogSubject:
    """Return what a data log of these components is about.

    Args:
        host: Where it is measured.
        members: Names of the components that share P1, sorted.
        interference: Name of the load in P2.

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
        confinement=GROUP_CONFINEMENT if host.provider is ProviderKind.LINUX else CONFINEMENT,
        fixes_processors=experiment.fixes_processors,
    )


def path_of(folder: Path, subject: LogSubject) -> Path:
    """Return where the data log of a subject lies.

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
        most_bytes: As of `Files`.
    """
    return Files(manifest.folder, most_bytes=most_bytes, code=manifest.code_folder)


def why_outdated(manifest: Manifest, host: Host, members: Names) -> str:
    """Tell why what was once measured of these components together does not hold any more.

    Args:
        manifest: The manifest, beside which its logs lie.
        host: On which they were to be together.
        members: Names of components, sorted; the manifest may know some no longer.

    Returns:
        A clause without a full stop; empty: their data log holds as it is.
    """
    system, files = manifest.system, files_of(manifest)
    if gone := [name for name in members if name not in system.components]:
        return f"the manifest has no {', '.join(gone)} any more"
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
        return "its data log is gone"
    return "; ".join(map(str, present(file, subject, files, known_platform(host)).comparison.changed))


def used_processors(
    system: System, host: Host, files: Files, platform_facts: ObservedPlatform, read: "_ReadLog | None" = None
) -> Used:
    """Return what data logs say of the processors that components use at once on a host.

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
        manifest: The manifest, beside which its logs lie.
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
        manifest: The manifest, beside which its logs lie.
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
        missed = (guaranteed(highest_missed(curves_of(group, log)), log.processors) for log in logs_together)
        return max(missed, default=Fraction(0))

    return MeasuredReservations(kinds=kinds, logs=logs, missed_together=missed_together)


def put_together(system: System, names: Names) -> tuple[System, Group]:
    """Put components into one partition, as those of a compound are measured.

    Args:
        names: Of its components, sorted.

    Returns:
        The manifest with that partition, called after the first of them, instead of those that they were in; and it.
    """
    others = {name: request for name, request in system.partitions.items() if not set(request.components) & set(names)}
    shared = PartitionRequest(name=names[0], components=names)
    together = replace(system, partitions={**others, names[0]: shared})
    return together, next(group for group in groups_of(together) if names_of(group.members) == names)


def curves_of(group: Group, log: MeasuredTogether) -> Iterator[tuple[Curve, Threshold]]:
    """Find what a log says of each threshold of a partition.

    Args:
        log: Of its members together.

    Yields:
        The curve of a member's index, and its threshold.
    """
    for member in group.members:
        for index, threshold in member.apt.items():
            yield log.curves(member.name, index), threshold


def present(file: LogFile, subject: LogSubject, files: Files, platform_facts: ObservedPlatform) -> Present:
    """Select what of a data log holds now.

    NOTE: interpreters outside of the folder are recorded by a measurement and not looked for here: nothing but files
    below the folder is opened for an untrusted manifest.
    """
    return present_log(file, subject.setup.members, identity_of(subject, files.of(subject), {}), platform_facts)


def known_platform(host: Host, facts: HostFacts | None = None) -> PartialPlatform:
    """Return what is known of a host now, to be compared with what a data log says of it.

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
    """Return what the log of each load says, or why it does not count, in the order of the loads."""
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

    NOTE: of a load that cannot take all by its nature RARMS325 tells, from the manifest; so this is not said of it.
    """
    names = names_of(group.members)
    loads = system.loads_of(names)
    measure = command("measure", interference=BUSY_LOOP, again=BUSY_LOOP in loads)
    return DIFFERENT.at(
        None,
        "{logs:all}: the load left more than {_short:%} of the processors idle. What is enough there need not be "
        "enough with others.",
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
    return MeasuredTogether(
        path=path,
        interference=subject.setup.interference,
        processors=number.number,
        processors_from=number.source,
        measured=tuple(sorted({setting.reserve for setting in log.settings})),
        curves=curves_in(log, {member.name: member for member in group.members}),
        records=log,
        others=found.others,
        remarks=tuple(_remarks(log, found, group, path, folder.files.cut)),
        again=_measuring(names_of(group.members)),
        weak=any(recorded.provenance.weak_load for recorded in log.counting),
        cpu_ms=_cpu_ms_in(log),
        used=most_used(recorded.setting for recorded in found.log.recorded),
    )


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
            prose("Measure it: ", again, ". Or fix its reserve (`cpu.reserve`)."),
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
            "{log} no longer holds. Since it was measured, this changed: {_changed}.",
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
        return prose("Measure again: ", again, ". Or take the change back.")
    return prose(
        "Is this another machine? Then give its host data logs of its own: `platform: NAME`. Was this machine changed? "
        "Then measure again: ",
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


def _cpu_ms_in(log: DataLog) -> Callable[[str], float | None]:
    """Return the processor time that a job of a component took, over all settings that can tell."""

    @cache
    def cpu_ms_of(component: str) -> float | None:
        recorded = [series for setting in log.settings for series in setting.series if series.component == component]
        with_cpu_time = [series for series in recorded if series.cpu_ms is not None and series.samples]
        jobs = sum(len(series.samples) for series in with_cpu_time)
        return sum(series.cpu_ms or 0.0 for series in with_cpu_time) / jobs if jobs else None

    return cpu_ms_of


def _remarks(log: DataLog, found: Present, group: Group, path: str, cut: str) -> Iterator[Diagnostic]:
    def remark(finding: Finding, template: str, advice: Wording, **facts: Given) -> Diagnostic:
        return finding.at(None, template, advice, address=_address(group), related=(), log=path, **facts)

    if unverified := found.comparison.unverified:
        yield remark(
            NOT_VERIFIED,
            "{log} was measured with {_files}: not looked at, since there is no such file here, or more than "
            "{_most:bytes} would be read.",
            "Plan where these files are, if it matters; nothing says that they changed.",
            files=unverified,
            _files=_list_some(unverified),
            _most=MOST_BYTES,
        )
    if cut:
        yield remark(
            NOT_VERIFIED,
            "{log}: {reason}. A change of what is left out is not noticed.",
            "Name fewer or smaller files in `run.files`, such as one folder.",
            reason=cut,
        )
    if differences := tuple(map(str, found.comparison.warns)):
        yield remark(
            DIFFERENT,
            "{log} was measured with another {_differences}.",
            "Measure again if that can matter to the component.",
            differences=differences,
            _differences=_list_some(differences),
        )
    if differences := tuple(map(str, found.other_hardware)):
        yield remark(
            DIFFERENT,
            "{log} was measured on two kinds of hardware, and the later one counts: {_differences}.",
            "Give each kind of machine data logs of its own: `platform: NAME` below its host.",
            differences=differences,
            _differences=_list_some(differences),
        )
    if found.others:
        yield remark(
            NOT_VERIFIED,
            "{log} has {settings:setting} from other conditions.",
            "Nothing has to be done. They count again when the conditions are the same again.",
            settings=found.others,
        )
    if running := tuple(sorted({name for recorded in log.counting for name in recorded.provenance.beside})):
        again = _measuring(names_of(group.members)).also(again=True)
        yield remark(
            DIFFERENT,
            "{log} was measured while {_partitions} ran on the host.",
            prose("Measure it once more with the host to itself, and this no longer counts: ", again, "."),
            partitions=running,
            _partitions=_list_some(running),
        )


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
