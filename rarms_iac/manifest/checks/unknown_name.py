"""References by name lead somewhere."""

from collections.abc import Collection, Iterable, Iterator

from rarms_iac.manifest.checks.common import address, partition_names
from rarms_iac.model.diagnostics import Diagnostic, Finding, Places, Severity
from rarms_iac.model.spelling import suggestion
from rarms_iac.model.system import System

MOST_SUGGESTIONS = 20
"""Names for which a near one is looked for: a file full of wrong names is told of at once all the same."""

FINDING = Finding(code="RARMS042", severity=Severity.ERROR, summary="A name that nothing has")


def check(system: System, places: Places) -> Iterator[Diagnostic]:
    """Tells of every host, component, partition or interference that is named and does not exist."""
    told = 0
    for path, name, kind, known in _references(system):
        if name not in known:
            told += 1
            meant = suggestion(name, known) if told <= MOST_SUGGESTIONS else ""
            yield FINDING.at(
                places.value(*path),
                f'There is no {kind} "{name}".{meant}',
                f"Correct the name, or add the {kind}.",
                address=_address(path),
            )


def _references(system: System) -> Iterator[tuple[tuple[str | int, ...], str, str, Collection[str]]]:
    for component in system.components.values():
        here = ("components", component.name)
        yield from _listed((*here, "together"), component.together, "component", system.components)
        yield from _listed((*here, "apart"), component.apart, "component", system.components)
        yield from _listed((*here, "hosts"), component.hosts or (), "host", system.hosts)
        if component.interference is not None:
            yield (*here, "interference"), component.interference, "interference", system.interference
    for partition in system.partitions.values():
        path = ("partitions", partition.name, "components")
        yield from _listed(path, partition.components, "component", system.components)
    yield ("policy", "interference"), system.policy.interference, "interference", system.interference
    if system.moved:
        partitions = partition_names(system)
        for old, new in system.moved.items():
            if new != old and system.moved.get(new) != old:  # else RARMS080 tells of it
                yield ("moved", old), new, "partition", partitions


def _listed(
    path: tuple[str, ...], names: Iterable[str], kind: str, known: Collection[str]
) -> Iterator[tuple[tuple[str | int, ...], str, str, Collection[str]]]:
    for number, name in enumerate(names):
        yield (*path, number), name, kind, known


def _address(path: tuple[str | int, ...]) -> str:
    section, name = str(path[0]), str(path[1])
    return address(section, name) if section in {"components", "partitions"} else ""
