"""Checks of names: what they refer to, which ones something else keeps, renamed partitions, and task classes."""

from collections.abc import Collection, Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass

from rarms_iac.manifest.checks.violation import (
    Path,
    Violation,
    check,
    known_tasks,
    operating_systems,
    partition_names,
    task_entry,
    violation,
)
from rarms_iac.model.commands import command, prose
from rarms_iac.model.host import LinuxHost
from rarms_iac.model.loads import LOADS_WITHOUT_ENTRY
from rarms_iac.model.mmcss import SYSTEM_RESPONSIVENESS
from rarms_iac.model.names import POWERSHELL_MEMBERS, ROBOTIC_TASKS, WINDOWS_DEVICES, is_shipped_task
from rarms_iac.model.setting import TEST_PARTITIONS
from rarms_iac.model.system import Component, System
from rarms_iac.model.version import __version__
from rarms_iac.texts.findings import CLASS_ORDER, OTHER_VERSION, UNKNOWN_NAME, Finding
from rarms_iac.texts.messages import MOST_NAMES, Suggestions

NOT_USED = Finding.note("RARMS086", "An entry is not used")

MOVED = Finding.error("RARMS080", "An entry of `moved` has no effect or cannot be applied")

KEPT_NAME = Finding.error("RARMS043", "This name is reserved")


SLICES_OF_OTHERS = frozenset({"system", "user", "machine", "init", "docker", "lxc", "kubepods", "libpod_parent"})
"""Control groups of systemd and of container engines."""


_ADVICE_ON_TASKS = f"Use one of {', '.join(ROBOTIC_TASKS)}, or add the class to `tasks`."


@check(UNKNOWN_NAME)
def unknown_name(system: System) -> Iterator[Violation]:
    """Find names of hosts, components, partitions, interference or task classes that do not exist."""
    suggestions = Suggestions()
    for path, name, kind, known in _references(system):
        if name not in known:
            similar, suggestion = suggestions.find(name, known)
            yield violation(
                path,
                'The {kind} "{name}" does not exist.{_suggestion}',
                _ADVICE_ON_TASKS if kind == "task class" else f"Correct the name, or add the {kind}.",
                address="" if path[0] in {"policy", "moved"} else None,
                kind=kind,
                name=name,
                similar=similar,
                _suggestion=suggestion,
            )


@check(OTHER_VERSION)
def older_than_required(system: System) -> Iterator[Violation]:
    """Yield a least version that this rarms does not reach."""
    required = (system.application.requires_rarms or "").removeprefix(">=").strip()
    if _numbers(required) > _numbers(__version__):
        yield violation(
            ("application", "requires_rarms"),
            "It requires rarms {requires} or newer, and this is rarms {version}.",
            "Install a newer rarms, or ask the author of the manifest why it needs this version.",
            address="",
            requires=required,
            version=__version__,
        )


def _numbers(version: str) -> tuple[int, ...]:
    """Return `0.2` as `(0, 2, 0)`; an empty version is the oldest."""
    numbers = [int(number) for number in version.split(".") if number]
    return tuple([*numbers, 0, 0, 0][:3])


def _references(system: System) -> Iterator[tuple[Path, str, str, Collection[str]]]:
    """Yield path, name, kind and existing names of everything that the manifest refers to by name."""
    tasks = known_tasks(system)
    folded = {name.lower() for name in tasks}
    for component in system.components.values():
        here = ("components", component.name)
        yield from _each((*here, "together"), component.together, "component", system.components)
        yield from _each((*here, "apart"), component.apart, "component", system.components)
        yield from _each((*here, "hosts"), component.hosts or (), "host", system.hosts)
        yield from _loads((*here, "interference"), component.interference, system)
        if component.run is not None and component.run.processes:
            named = component.run.samples.process
            yield (*here, "run", "samples", "process"), named, "process", component.run.processes
        task = component.task_class
        if task is not None and task.lower() not in folded and not is_shipped_task(task):
            yield (*here, "task"), task, "task class", tasks
    for partition in system.partitions.values():
        path = ("partitions", partition.name, "components")
        yield from _each(path, partition.components, "component", system.components)
    yield from _loads(("policy", "interference"), system.policy.interference, system)
    if system.moved:
        partitions = partition_names(system)
        for old, new in system.moved.items():
            if new != old and system.moved.get(new) != old:  # else RARMS080 reports it
                yield ("moved", old), new, "partition", partitions


def _loads(
    path: tuple[str, ...], names: Sequence[str], system: System
) -> Iterator[tuple[Path, str, str, Collection[str]]]:
    """Yield references to loads; one name may stand without a list, and then has the path of the key."""
    if len(names) == 1:
        yield path, names[0], "interference", system.interference
    else:
        yield from _each(path, names, "interference", system.interference)


def _each(
    path: tuple[str, ...], names: Iterable[str], kind: str, known: Collection[str]
) -> Iterator[tuple[Path, str, str, Collection[str]]]:
    for number, name in enumerate(names):
        yield (*path, number), name, kind, known


@dataclass(frozen=True, slots=True, kw_only=True)
class _Kept:
    """Names that something else keeps, and those of the manifest that must not be among them, by their paths."""

    kept: Collection[str]
    names: Iterable[tuple[Path, str]]
    template: str
    advice: str  # a format with `name`
    at: str = ""  # the kind of the address; empty: as the path says


def _kept(system: System) -> Iterator[_Kept]:
    application = (("application", "name"), system.application.name)
    partitions = [((system.section_of(name), name), name) for name in sorted(partition_names(system))]
    users = [
        (("components", name, "task"), each.task_class) for name, each in system.components.items() if each.task_class
    ]
    sections = {
        "hosts": system.hosts,
        "components": system.components,
        "partitions": system.partitions,
        "interference": system.interference,
    }
    yield _Kept(
        kept=WINDOWS_DEVICES,
        names=[application, *(((section, name), name) for section, names in sections.items() for name in names)],
        template=(
            'The name "{name}" is reserved for a device in Windows. Folders, virtual machines and data logs '
            "cannot have it."
        ),
        advice='Choose another name, for example "{name}-1".',
    )
    yield _Kept(
        kept=POWERSHELL_MEMBERS,
        names=[application],
        template='The name "{name}" is reserved in PowerShell, which could not read a journal with this name.',
        advice='Choose another name, for example "{name}-1".',
    )
    yield _Kept(
        kept={name.lower() for name in system.hosts},
        names=partitions,
        template='"{name}" is also the name of a host. Hyper-V lists the host computer among its machines, so a '
        "search for the partition may find the host.",
        advice="Rename the host or the partition. A partition without an entry has the name of its component.",
        at="partition",
    )
    yield _Kept(
        kept=TEST_PARTITIONS,
        names=partitions,
        template='`rarms measure` creates and removes a partition with the name "{name}".',
        advice="Rename the partition. A partition without an entry has the name of its component.",
        at="partition",
    )
    yield _Kept(
        kept=SLICES_OF_OTHERS,
        names=[
            (("hosts", name, "linux", "slice"), host.settings.slice)
            for name, host in system.hosts.items()
            if isinstance(host.settings, LinuxHost)
        ],
        template=(
            '"{host}" has the slice "{name}", which belongs to systemd or to a container engine. rarms would limit '
            "all programs in the slice, and stop the slice with the last partition."
        ),
        advice="Choose another name, or leave `slice` out to use `rarms`.",
    )
    yield _Kept(
        kept={SYSTEM_RESPONSIVENESS.lower()},
        names=[*((("tasks", name), name) for name in system.tasks), *users],
        template='rarms stores the value of `system_responsiveness` under the name "{name}". A task class cannot '
        "have this name.",
        advice="Rename the class. To set the value itself, write `system_responsiveness` at the host.",
        at="task",
    )


@check(KEPT_NAME)
def kept_name(system: System) -> Iterator[Violation]:
    """Find names that Windows, PowerShell, systemd or rarms keeps for something else."""
    for row in _kept(system):
        for path, name in row.names:
            if name.lower() in row.kept:
                yield violation(
                    path,
                    row.template,
                    row.advice.format(name=name),
                    at_key=path[-1] == name and path[0] != "application",
                    address=f"{row.at}/{name}" if row.at else None,
                    name=name,
                )


@check(MOVED)
def moved_nowhere(system: System) -> Iterator[Violation]:
    """Find entries of `moved` that lead back to their start, or whose old name a partition still has."""
    lengths = _circle_lengths(system.moved)
    existing = partition_names(system) if system.moved else set()
    for old, new in system.moved.items():
        if length := lengths.get(old):
            reason = "the name would not change" if length == 1 else "every plan would rename them again"
            names = [old]
            while len(names) < min(length, MOST_NAMES):
                names.append(system.moved[names[-1]])
            following = [f"{length - MOST_NAMES} more"] if length > MOST_NAMES else []
            yield violation(
                ("moved", old),
                "{_circle}: {_reason}.",
                "Write an old name that is no longer in the manifest, and a new name that is in the manifest.",
                at_key=True,
                address=f"partition/{old}",
                names=tuple(names),
                length=length,
                _circle=" -> ".join([*names, *following, old]),
                _reason=reason,
            )
        elif old in existing:
            yield violation(
                ("moved", old),
                '`moved` renames "{old}" to "{new}", but the manifest still has a partition "{old}".',
                "Remove the entry, or rename the partition.",
                at_key=True,
                address=f"partition/{old}",
                old=old,
                new=new,
            )


def _circle_lengths(moved: Mapping[str, str]) -> dict[str, int]:
    """Return the names that lead back to themselves, each with the number of entries that this takes.

    Every entry occurs once.
    """
    seen: set[str] = set()
    lengths: dict[str, int] = {}
    for start in moved:
        walk: dict[str, int] = {}
        name = start
        while name in moved and name not in seen:
            seen.add(name)
            walk[name] = len(walk)
            name = moved[name]
        if name in walk:
            circle = [passed for passed, number in walk.items() if number >= walk[name]]
            lengths |= dict.fromkeys(circle, len(circle))
    return lengths


@check(Finding.warning("RARMS089", "The manifest has no component"))
def no_components(system: System) -> Iterator[Violation]:
    """Yield a manifest without components."""
    if not system.components:
        yield violation(
            ("components",),
            "The manifest has no components. A plan would stop every partition that rarms created before.",
            prose("Add a component. To remove everything, use ", command("destroy"), "."),
            address=f"application/{system.application.name}",
        )


@check(NOT_USED)
def unused_interference(system: System) -> Iterator[Violation]:
    """Find interference that neither the policy nor a component names."""
    used = {*system.policy.interference}.union(*(component.interference for component in system.components.values()))
    for name in system.interference:
        if name not in used and name not in LOADS_WITHOUT_ENTRY:
            yield violation(
                ("interference", name),
                'Neither `policy.interference` nor a component names "{interference}".',
                "Use the load in one of them, or remove it. Keep a load that you only use with `--interference`.",
                at_key=True,
            )


@check(Finding.error("RARMS053", "A task class of Windows would be changed"))
def shipped_task(system: System) -> Iterator[Violation]:
    """Find classes that come with Windows and would be changed without `replace_shipped`."""
    for task in system.tasks.values():
        if is_shipped_task(task.name) and not task.replace_shipped:
            yield _shipped_task_violation(("tasks", task.name), task.name)
    for component in system.components.values():
        name = component.task_class
        if name is not None and is_shipped_task(name) and task_entry(system, name) is None:
            yield _shipped_task_violation(("components", component.name, "task"), name)


def _shipped_task_violation(path: Path, name: str) -> Violation:
    return violation(
        path,
        'The class "{task}" comes with Windows, and other programs use it. rarms would change its values.',
        f"Use a robotic class such as {ROBOTIC_TASKS[1]}, or write `replace_shipped: true` in `tasks.{name}`.",
        at_key=path[0] == "tasks",
        address=f"task/{name}",
        task=name,
    )


@check(KEPT_NAME)
def task_differs_in_case(system: System) -> Iterator[Violation]:
    """Yield the later of two entries that the registry would take for one."""
    first: dict[str, str] = {}
    for name in system.tasks:
        before = first.setdefault(name.lower(), name)
        if before != name:
            yield violation(
                ("tasks", name),
                '"{task}" and "{other}" are the same registry key: Windows ignores case in these names.',
                "Keep one of the two.",
                at_key=True,
                related=((("tasks", before), True, "the other one"),),
                other=before,
            )


@check(CLASS_ORDER)
def shared_task(system: System) -> Iterator[Violation]:
    """Yield the less critical users of a class, whose threads get the priority of the most critical one."""
    for group in operating_systems(system):
        most_critical: dict[str, Component] = {}
        for component in sorted(group, key=lambda component: (-component.criticality, component.name)):
            if component.task_class is None:
                continue
            leader = most_critical.setdefault(component.task_class.lower(), component)
            if leader.criticality > component.criticality:
                yield violation(
                    ("components", component.name, "task"),
                    '"{component}" (criticality {criticality}) and "{other}" ({other_criticality}) share '
                    "the class {task} in one operating system. The threads of both get the same priority.",
                    "Give the less critical component a class of its own.",
                    task=component.task_class,
                    criticality=component.criticality,
                    other=leader.name,
                    other_criticality=leader.criticality,
                )


@check(NOT_USED)
def unused_task(system: System) -> Iterator[Violation]:
    """Find entries of `tasks` that no component names."""
    used = {each.task_class.lower() for each in system.components.values() if each.task_class is not None}
    for name in system.tasks:
        if name.lower() not in used:
            yield violation(
                ("tasks", name),
                "No component has `task: {task}`, so the class has no effect.",
                "Use the class in a component, or remove the class.",
                at_key=True,
            )
