"""Checks of names: what they refer to, which ones Windows or rarms keeps for itself, and renamed partitions."""

from collections.abc import Collection, Iterable, Iterator, Mapping, Sequence
from typing import Any

from rarms_iac.manifest.checks.system_lookups import partition_names
from rarms_iac.manifest.checks.violation import Path, Violation, check, violation
from rarms_iac.model.commands import command, prose
from rarms_iac.model.diagnostics import Finding
from rarms_iac.model.environment_setup import TEST_PARTITIONS
from rarms_iac.model.loads import LOADS_WITHOUT_ENTRY
from rarms_iac.model.names import POWERSHELL_MEMBERS, WINDOWS_DEVICES
from rarms_iac.model.shared_findings import OTHER_VERSION, UNKNOWN_NAME
from rarms_iac.model.system import System
from rarms_iac.model.version import __version__
from rarms_iac.model.wording import MOST_NAMES, Suggestions

NOT_USED = Finding.note("RARMS086", "An entry is not used")

MOVED = Finding.error("RARMS080", "An entry of `moved` cannot be carried out")

KEPT_NAME = Finding.error("RARMS043", "This name is kept for something else")


@check(UNKNOWN_NAME)
def unknown_name(system: System) -> Iterator[Violation]:
    """Every host, component, partition or interference that is named and does not exist."""
    suggestions = Suggestions()
    for path, name, kind, known in _references(system):
        if name not in known:
            similar, suggestion = suggestions.find(name, known)
            yield violation(
                path,
                'There is no {kind} "{name}".{_suggestion}',
                f"Correct the name, or add the {kind}.",
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
            "Install a newer rarms, or ask the author of the requirement what it is for.",
            address="",
            requires=required,
            version=__version__,
        )


def _numbers(version: str) -> tuple[int, ...]:
    """`0.2` as `(0, 2, 0)`; no version is the oldest."""
    numbers = [int(number) for number in version.split(".") if number]
    return tuple([*numbers, 0, 0, 0][:3])


def _references(system: System) -> Iterator[tuple[Path, str, str, Collection[str]]]:
    """Path, name, kind and the names that exist, of everything that the manifest refers to by name."""
    for component in system.components.values():
        here = ("components", component.name)
        yield from _each((*here, "together"), component.together, "component", system.components)
        yield from _each((*here, "apart"), component.apart, "component", system.components)
        yield from _each((*here, "hosts"), component.hosts or (), "host", system.hosts)
        yield from _loads((*here, "interference"), component.interference, system)
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
    """NOTE: one name may stand without a list, and then has the path of the key."""
    if len(names) == 1:
        yield path, names[0], "interference", system.interference
    else:
        yield from _each(path, names, "interference", system.interference)


def _each(
    path: tuple[str, ...], names: Iterable[str], kind: str, known: Collection[str]
) -> Iterator[tuple[Path, str, str, Collection[str]]]:
    for number, name in enumerate(names):
        yield (*path, number), name, kind, known


@check(KEPT_NAME)
def device_name(system: System) -> Iterator[Violation]:
    """Hosts, components, partitions and interference that no Windows folder can be called after."""
    sections = {
        "hosts": system.hosts,
        "components": system.components,
        "partitions": system.partitions,
        "interference": system.interference,
    }
    if system.application.name in WINDOWS_DEVICES:
        yield _device_violation(("application", "name"), system.application.name, at_key=False)
    for section, names in sections.items():
        for name in names:
            if name in WINDOWS_DEVICES:
                yield _device_violation((section, name), name, at_key=True)


def _device_violation(path: Path, name: str, *, at_key: bool) -> Violation:
    return violation(
        path,
        'Windows keeps the name "{name}" for a device. No folder can have this name, so no virtual '
        "machine and no data log can have it.",
        f'Choose another name, for example "{name}-1".',
        at_key=at_key,
        name=name,
    )


@check(KEPT_NAME)
def powershell_name(system: System) -> Iterator[Violation]:
    """Yield an application whose name no object of PowerShell can have as a property, as a journal's would."""
    name = system.application.name
    if name in POWERSHELL_MEMBERS:
        yield violation(
            ("application", "name"),
            'PowerShell keeps the name "{name}" for a member of every object: a journal with the runs of '
            "this application could not be read.",
            f'Choose another name, for example "{name}-1".',
            name=name,
        )


@check(KEPT_NAME)
def partition_like_host(system: System) -> Iterator[Violation]:
    """Partitions, with an entry or without, that have a host's name."""
    hosts = {name.lower() for name in system.hosts}
    for name in sorted(partition_names(system)):
        if name.lower() in hosts:
            yield _partition_name_violation(
                system,
                name,
                '"{name}" is also the name of a host. Hyper-V lists the host computer among its machines, so that a '
                "search for the partition may find the host.",
                "Rename the host or the partition (the component, if the partition has no entry).",
            )


@check(KEPT_NAME)
def test_partition_name(system: System) -> Iterator[Violation]:
    """Partitions, with an entry or without, that measuring would remove."""
    for name in sorted({*partition_names(system)} & {*TEST_PARTITIONS}):
        yield _partition_name_violation(
            system,
            name,
            "`rarms measure` creates and removes partitions with the names {test_partitions:all}.",
            "Rename the partition (the component, if the partition has no entry).",
            test_partitions=tuple(TEST_PARTITIONS),
        )


def _partition_name_violation(system: System, name: str, template: str, advice: str, **facts: Any) -> Violation:
    path = (system.section_of(name), name)
    return violation(path, template, advice, at_key=True, address=f"partition/{name}", name=name, **facts)


@check(MOVED)
def moved_in_a_circle(system: System) -> Iterator[Violation]:
    """Entries of `moved` that lead back to where they start."""
    lengths = _circle_lengths(system.moved)
    for old in system.moved:
        if length := lengths.get(old):
            reason = "the name would not change" if length == 1 else "every plan would rename them again"
            names = [old]
            while len(names) < min(length, MOST_NAMES):
                names.append(system.moved[names[-1]])
            following = [f"{length - MOST_NAMES} more"] if length > MOST_NAMES else []
            yield violation(
                ("moved", old),
                "{_circle}: {_reason}.",
                "Let each entry lead from a name that the manifest no longer has to a name that it has.",
                at_key=True,
                address=f"partition/{old}",
                names=tuple(names),
                length=length,
                _circle=" -> ".join([*names, *following, old]),
                _reason=reason,
            )


@check(MOVED)
def moved_from_existing(system: System) -> Iterator[Violation]:
    """Entries of `moved` whose old name a partition of the manifest still has."""
    names = partition_names(system) if system.moved else set()
    in_circles = _circle_lengths(system.moved)
    for old, new in system.moved.items():
        if old in names and old not in in_circles:  # else RARMS080 reports it
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
            "The manifest describes no component. A plan would stop every partition that rarms created before.",
            prose("Add a component. To remove everything, use ", command("destroy"), "."),
            address=f"application/{system.application.name}",
        )


@check(NOT_USED)
def unused_interference(system: System) -> Iterator[Violation]:
    """Interference that neither the policy nor a component names."""
    used = {*system.policy.interference}.union(*(component.interference for component in system.components.values()))
    for name in system.interference:
        if name not in used and name not in LOADS_WITHOUT_ENTRY:
            yield violation(
                ("interference", name),
                'Neither `policy.interference` nor a component names "{interference}".',
                "Name it, or remove it. Leave it if you only measure with it by hand.",
                at_key=True,
            )
