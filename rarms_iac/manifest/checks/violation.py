"""What a check is, and what it reports: violations, with their places in the manifest."""

from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass
from itertools import chain

from rarms_iac.model.commands import Wording
from rarms_iac.model.diagnostics import Diagnostic, Facts, Finding, Place, Places, Related
from rarms_iac.model.host import Host
from rarms_iac.model.system import Component, PartitionRequest, System

Path = tuple[str | int, ...]

_ADDRESSED = ("hosts", "components", "partitions", "interference", "tasks")


@dataclass(frozen=True, slots=True, kw_only=True)
class Violation:
    """One case of a check's finding: where in the manifest, what is wrong, and what to do."""

    path: Path
    detail: str
    advice: Wording
    values: Facts  # the names and numbers of `detail`, but for the name that the path leads into
    at_key: bool = False  # it points at the key of the path, not at its value
    address: str | None = None  # as `policy.accept` names it; None: the host, component, ... that the path leads into
    related: tuple[tuple[Path, bool, str], ...] = ()  # other paths, whether their key is meant, and a label

    def as_diagnostic(self, finding: Finding, places: Places) -> Diagnostic:
        """The violation as a case of this finding, with its places in the manifest's text."""
        related = tuple(Related(place=_place(places, path, key), message=label) for path, key, label in self.related)
        return finding.at(
            _place(places, self.path, self.at_key),
            self.detail,
            self.advice,
            values={**_owner(self.path), **self.values},
            address=self._address() if self.address is None else self.address,
            related=related,
        )

    def _address(self) -> str:
        """`components, vision, cpu` -> `component/vision`, as `policy.accept` names it."""
        return next((f"{kind}/{name}" for kind, name in _owner(self.path).items()), "")


Check = Callable[[System], Iterator[Violation]]
"""A check yields every violation that it finds; it judges only what no other check judges."""


def of_components(check: Callable[[Component], Iterator[Violation]]) -> Check:
    """The check of a manifest that judges one component after the other."""
    return lambda system: chain.from_iterable(map(check, system.components.values()))


def of_hosts(check: Callable[[Host], Iterator[Violation]]) -> Check:
    """The check of a manifest that judges one host after the other."""
    return lambda system: chain.from_iterable(map(check, system.hosts.values()))


def of_partitions(check: Callable[[System, PartitionRequest], Iterator[Violation]]) -> Check:
    """The check of a manifest that judges one partition's entry after the other, beside what it names."""
    return lambda system: chain.from_iterable(check(system, partition) for partition in system.partitions.values())


def _place(places: Places, path: Path, at_key: bool) -> Place:
    return places.key(*path) if at_key else places.value(*path)


def _owner(path: Path) -> Mapping[str, str]:
    """Kind and name of the entry that a path leads into: `components, vision, cpu` -> `component: vision`."""
    if len(path) < 2 or path[0] not in _ADDRESSED:
        return {}
    return {str(path[0]).removesuffix("s"): str(path[1])}
