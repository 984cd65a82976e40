"""Preconditions of planning: rights to see a host's machines, a scheduler that honours reserves, no host twice."""

from collections import defaultdict
from collections.abc import Iterable, Iterator, Mapping
from dataclasses import replace
from typing import Any

from rarms_iac.applying.refusals import OTHERS_RUN
from rarms_iac.model.changes import RESPONSIVENESS, Address
from rarms_iac.model.diagnostics import Diagnostic, Place, Places
from rarms_iac.model.host import LinuxHost, SchedulerType
from rarms_iac.model.setting import TEST_PARTITIONS
from rarms_iac.model.state import HostFacts, Rights, State
from rarms_iac.model.system import Application, System
from rarms_iac.planner.mechanism import IGNORED_RESERVES, asks_for_processors, ignores_reserves
from rarms_iac.texts.findings import Finding
from rarms_iac.texts.messages import natural_order, quoted

NO_RIGHTS = Finding.error("RARMS158", "The right to manage the host is not proven")
SCHEDULER = Finding.error(IGNORED_RESERVES, "The host's scheduler does not honour reserves")

UNKNOWN_SCHEDULER = Finding.warning("RARMS166", "The host's scheduler is not known")


def unproven_rights(observed: Iterable[State], places: Places) -> Iterator[Diagnostic]:
    """Yield the hosts of which we do not know that we see everything: they may look empty and be full."""
    for state in observed:
        if state.facts.rights is not Rights.PROVEN:
            yield no_rights(state.facts, places.key("hosts", state.facts.name))


def marks_of_other_robots(observed: Iterable[State], application: Application) -> Iterator[Diagnostic]:
    """Find what another robot has of the application; marks that name no robot are taken over.

    Args:
        application: whose marks and records are looked at, with the name of its robot.

    Yields:
        A finding for each such partition, task class and SystemResponsiveness.
    """
    for state in observed:
        host, managed = state.facts.name, state.of(application.name)
        for partition in managed.partitions:
            assert partition.mark is not None, "a managed partition has a mark"
            name = partition.mark.name
            marked = f"Partition {quoted(name)} on {host} has the mark of"
            yield from _other_robot(
                marked, partition.mark.robot, f"partition/{name}", host, application, machine=partition.id
            )
        for task in managed.tasks:
            assert task.record is not None, "a managed task class has a record"
            inside = f" in the guest of {quoted(task.inside)}" if task.inside else ""
            recorded = f"The task class {quoted(task.name)}{inside} on {host} has a record of"
            address = str(Address(partition=task.inside, task=task.name))
            yield from _other_robot(recorded, task.record.robot, address, host, application)
        if managed.responsiveness and managed.responsiveness.record:
            address = str(Address(responsiveness=True))
            recorded = f"SystemResponsiveness on {host} has a record of"
            yield from _other_robot(recorded, managed.responsiveness.record.robot, address, host, application)


def _other_robot(
    subject: str, robot: str, address: str, host: str, application: Application, **values: Any
) -> Iterator[Diagnostic]:
    if robot in {"", application.robot}:
        return
    own = (
        f"This manifest is for the robot {quoted(application.robot)}."
        if application.robot
        else "No overlay of a robot was given."
    )
    yield OTHERS_RUN.at(
        None,
        "{_subject} the robot {robot:quoted}. {_own}",
        f"Nothing was changed. Check the host's address, or use that robot's overlay, {robot}.yaml, as the last "
        f"overlay.",
        address=address,
        host=host,
        robot=robot,
        own_robot=application.robot,
        _subject=subject,
        _own=own,
        **values,
    )


def marked_resources(state: State) -> tuple[str, ...]:
    """Name what runs of any application left on a host: without a journal there, the journal is missing.

    Returns:
        Partitions and task classes in short form, sorted; not test partitions, of which no journal knows.
    """
    marks = (partition.mark for partition in state.partitions)
    found = {mark.name for mark in marks if mark is not None and mark.name not in TEST_PARTITIONS}
    found |= {Address(partition=task.inside, task=task.name).in_short for task in state.tasks if task.record}
    if state.responsiveness is not None and state.responsiveness.record:
        found.add(RESPONSIVENESS.in_short)
    return tuple(sorted(found, key=natural_order))


def no_rights(facts: HostFacts, place: Place | None = None) -> Diagnostic:
    """Return the finding about a host of which it is unknown whether everything was seen."""
    lack = "does not have the right to" if facts.rights is Rights.MISSING else "could not prove the right to"
    return NO_RIGHTS.of_host(
        facts.name,
        "On {host}, rarms {lack} manage machines. It cannot read or change them.",
        "Run rarms as an administrator of the host. On a simulated host, write `administrator: true`.",
        place=place,
        rights=facts.rights.value,
        lack=lack,
    )


def ignored_reserves(desired: State, places: Places) -> Iterator[Diagnostic]:
    """Yield a host on which the wanted reserves, limits or weights would have no effect, or none that is known."""
    asked = [partition.settings.name for partition in desired.partitions if asks_for_processors(partition.settings)]
    if asked:
        for finding in scheduler_findings(desired.facts, ", ".join(asked), None):  # places are looked for only then
            yield replace(finding, place=places.key("hosts", desired.facts.name))


def scheduler_findings(facts: HostFacts, whose: str, place: Place | None) -> Iterator[Diagnostic]:
    """Yield a host on which no reserve has an effect (an error), or none that is known; `whose` would have one."""
    why = _why_ignored(facts)
    if why:
        yield SCHEDULER.of_host(
            facts.name,
            "{host} {why}: reserve, limit and weight of {_whose} would have no effect.",
            f"{_scheduler_advice(facts)} Otherwise use another host, or accept RARMS159 at host/{facts.name}.",
            place=place,
            scheduler=facts.scheduler.value,
            why=why,
            _whose=whose,
        )
    elif facts.scheduler is SchedulerType.UNKNOWN:
        yield UNKNOWN_SCHEDULER.of_host(
            facts.name,
            "{host} does not report its scheduler, so reserve, limit and weight of {_whose} may have no effect.",
            (
                "Restart the host to log event 2 of Microsoft-Windows-Hyper-V-Hypervisor again. Or run `bcdedit "
                "/enum {current}` on the host. Reserves have no effect if hypervisorschedulertype is Root."
            ),
            place=place,
            scheduler=facts.scheduler.value,
            _whose=whose,
        )


def _scheduler_advice(facts: HostFacts) -> str:
    if facts.client:
        return "Install a Windows Server: a client supports only the root scheduler."
    return (
        "Run `bcdedit /set hypervisorschedulertype core` and restart the host. Some builds need `bcdedit /set "
        "{hypervisorsettings} hypervisorschedulertype core`."
    )


def _why_ignored(facts: HostFacts) -> str:
    """Say why the host ignores reserves; empty where it does not.

    A client Windows whose scheduler is not known is taken to have the root scheduler.
    """
    if not ignores_reserves(facts):
        return ""
    if facts.scheduler is SchedulerType.ROOT:
        return "runs the root scheduler"
    return "is a client Windows, which runs the root scheduler"


ONE_MACHINE = Finding.warning("RARMS343", "Several hosts are one machine")


def hosts_of_one_machine(system: System, observed: Mapping[str, State], places: Places) -> Iterator[Diagnostic]:
    """Report hosts with the identity of another host of the plan.

    Args:
        observed: their states, by name; those without an identity are left out.
        places: where they stand in the manifest.

    Yields:
        A finding for each identity that several hosts have, at the first of them by name.
    """
    hosts_of: dict[str, list[str]] = defaultdict(list)
    for name, state in sorted(observed.items()):
        if state.facts.id:
            hosts_of[state.facts.id].append(name)
    for names in hosts_of.values():
        if len(names) > 1:
            slices = [
                settings.slice for name in names if isinstance(settings := system.hosts[name].settings, LinuxHost)
            ]
            make = _slices if len(set(slices)) == len(names) else _clones
            yield make(names, places)


def _clones(names: list[str], places: Places) -> Diagnostic:
    return ONE_MACHINE.at(
        places.key("hosts", names[0]),
        (
            "The hosts {hosts:all} have the same machine id. Their addresses lead to one machine, or the "
            "machines were cloned from one image."
        ),
        (
            "Check the addresses in `connect`. Give each clone its own machine id. Otherwise rarms mixes up "
            "their proofs and journals."
        ),
        address=f"host/{names[0]}",
        hosts=tuple(names),
    )


def _slices(names: list[str], places: Places) -> Diagnostic:
    return ONE_MACHINE.at(
        places.key("hosts", names[0]),
        "The hosts {hosts:all} are slices of one machine. rarms plans each slice as if it had all processors.",
        "Combine the slices into one host. Or keep the part of the other slices free with `keep_for_host`.",
        address=f"host/{names[0]}",
        hosts=tuple(names),
    )
