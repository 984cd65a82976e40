"""Finds a running service or container that a component is attached to, and refuses one that cannot be held to CR.

In: `run.attach` of the manifest. Out: an `AttachTarget`, its processes and where they are. Nothing is changed here.
"""

import os
from collections.abc import Iterator, Sequence
from contextlib import suppress
from dataclasses import dataclass
from pathlib import Path

from rarms_iac.model.run import Attached, AttachedContainer, AttachedService
from rarms_iac.providers.cgroups.effects import LinuxEffects
from rarms_iac.providers.cgroups.groups import GroupTree
from rarms_iac.running.engines import SYSTEMD, engine_of, unit_of
from rarms_iac.running.kernel_files import PROC, kernel_text, read_process
from rarms_iac.running.orders import CannotStart
from rarms_iac.texts.messages import reason_of

_UNITS = (".service", ".scope")
_MANAGER_OF_USER = "user@"
_SSHD = frozenset({"sshd", "sshd-session", "sshd-auth"})
"""Programs of a connection: since OpenSSH 9.8 and 10 each has its own."""
_POLICIES = {os.SCHED_FIFO: "SCHED_FIFO", os.SCHED_RR: "SCHED_RR", 6: "SCHED_DEADLINE"} if os.name == "posix" else {}


@dataclass(frozen=True, slots=True, kw_only=True)
class AttachTarget:
    """A running service or container."""

    component: str
    title: str  # `the service nav2.service`
    group: Path  # its control group, in the hierarchy of the processor time
    unit: str  # of systemd; empty: systemd does not run here


def find_target(component: str, attached: Attached, tree: GroupTree, effects: LinuxEffects) -> AttachTarget:
    """Return what a component is attached to.

    Raises:
        CannotStart: it does not run, its name is ambiguous, or it must not or cannot be held to a part of the host.
        OSError, UnreadableFile: the machine cannot be asked.
    """
    if isinstance(attached, AttachedService):
        title, group = f"the service {attached.service}", _group_of_service(component, attached.service, tree, effects)
    else:
        title = f"the container {attached.container}"
        group = _group_of_container(component, attached, tree, effects)
    if SYSTEMD.is_dir():
        group = _group_of_unit(component, title, group)
    target = AttachTarget(component=component, title=title, group=group, unit=group.name if SYSTEMD.is_dir() else "")
    _refuse(target, tree.members_below(group))
    return target


def _group_of_service(component: str, service: str, tree: GroupTree, effects: LinuxEffects) -> Path:
    if not SYSTEMD.is_dir():
        raise CannotStart(
            component, "it is attached to a service, but systemd does not run here", "Set `command` instead."
        )
    unit = unit_of(service)
    instances = f"{unit.removesuffix('.service')}@*.service"
    found = effects.output("systemctl", "list-units", "--plain", "--no-legend", "--state=active", unit, instances)
    units = [line.split()[0] for line in found.splitlines() if line.strip()]
    if len(units) > 1:
        advice = f"Write the full name, such as `service: {units[0]}`."
        raise CannotStart(component, f"several services have the name {service}: {', '.join(units)}", advice)
    if units and units != [unit]:
        advice = f"Write `service: {units[0].removesuffix('.service')}`."
        raise CannotStart(component, f"the service {unit} is not running, but its instance {units[0]} is", advice)
    if not units:
        raise CannotStart(component, f"the service {unit} is not running", f"Start it: `systemctl start {unit}`.")
    path = effects.output("systemctl", "show", "--property=ControlGroup", "--value", units[0])
    return tree.folder_of(path)


def _group_of_container(component: str, attached: AttachedContainer, tree: GroupTree, effects: LinuxEffects) -> Path:
    engine, name = engine_of(component, attached), attached.container
    try:
        process = effects.output(engine, "inspect", "--type=container", "--format={{.State.Pid}}", name)
    except OSError as problem:
        advice = f"List the names with `{engine} ps`."
        raise CannotStart(
            component, f"{engine} does not have the container {name}: {reason_of(problem)}", advice
        ) from problem
    if not process.isdecimal() or process == "0":
        raise CannotStart(component, f"the container {name} is not running", f"Start it: `{engine} start {name}`.")
    return tree.home_of(int(process))


def _group_of_unit(component: str, title: str, group: Path) -> Path:
    """Return the group of the unit that it is, or is below: systemd alone may change groups.

    Of several the outermost one: those below it are of a systemd in the container (`init.scope`), or of crun.
    """
    for part in (*reversed(group.parents), group):
        if part.name.startswith(_MANAGER_OF_USER):
            message = f"{title} belongs to a user's own systemd ({part.name}), which contains all services of that user"
            raise CannotStart(component, message, "Start the container as root.")
        if part.suffix in _UNITS:
            return part
    message = f"{title} runs in {group}, which is not a unit of systemd"
    raise CannotStart(
        component, message, "Set its engine to use systemd for control groups: `--cgroup-manager=systemd`."
    )


def _refuse(target: AttachTarget, processes: Sequence[int]) -> None:
    own, advice = {*_ancestors(os.getpid())}, "Attach to a service or container that contains only the component."
    if not processes:
        raise CannotStart(target.component, f"{target.title} has no process", "Start it.")
    for process in processes:
        name = _name(process)
        if process == 1 or process in own or name in _SSHD:
            carries = "process 1" if process == 1 else "rarms itself" if process in own else f"{name} ({process})"
            message = f"{target.title} contains {carries}, which would also be limited to the reservation under test"
            raise CannotStart(target.component, message, advice)
    for process in processes:
        for thread in _threads(process):
            with suppress(ProcessLookupError):
                policy = os.sched_getscheduler(thread) & ~os.SCHED_RESET_ON_FORK
                if policy in _POLICIES:
                    message = f"thread {thread} ({_name(process)}) of {target.title} has {_POLICIES[policy]}, and "
                    message += "a quota does not limit such a thread"
                    raise CannotStart(
                        target.component, message, "Let rarms start the component: set `command` and `task`."
                    )


def _ancestors(process: int) -> Iterator[int]:
    while process > 1:
        yield process
        stat = read_process(process)
        process = stat.parent if stat else 0


def _name(process: int) -> str:
    return kernel_text(PROC / f"{process}/comm").strip()


def _threads(process: int) -> list[int]:
    with suppress(OSError):
        return [int(entry.name) for entry in (PROC / f"{process}/task").iterdir()]
    return []
