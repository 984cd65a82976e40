"""What a check is, and what it reports: violations, with their places in the manifest."""

from collections.abc import Callable, Iterator, Mapping
from itertools import chain

from rarms_iac.model.commands import Wording
from rarms_iac.model.diagnostics import Diagnostic, Finding, Given, Place, Places, Related
from rarms_iac.model.host import Host
from rarms_iac.model.system import Component, PartitionRequest, System

Path = tuple[str | int, ...]

_ADDRESSED = ("hosts", "components", "partitions", "interference", "tasks")


Violation = Callable[[Finding, Places], Diagnostic]
"""One case of a check, to be made a finding of its kind with its places in the manifest's text."""


def violation(
    path: Path,
    template: str,
    advice: Wording,
    *,
    at_key: bool = False,
    address: str | None = None,
    related: tuple[tuple[Path, bool, str], ...] = (),
    **facts: Given,
) -> Violation:
    """Return one case of a check; places are looked up only for those that are shown.

    Args:
        path: Where in the manifest. The host, component, ... that it leads into is a fact under that name.
        template: As of `Finding.at`, with `facts`.
        at_key: The place is the key of the path, not its value.
        address: As `policy.accept` names it; None: the host, component, ... that the path leads into.
        related: Other paths, whether their key is meant, and a label.
    """

    def case(finding: Finding, places: Places) -> Diagnostic:
        return finding.at(
            _place(places, path, at_key),
            template,
            advice,
            address=next((f"{kind}/{name}" for kind, name in _owner(path).items()), "") if address is None else address,
            related=tuple(Related(place=_place(places, other, key), message=label) for other, key, label in related),
            **{**_owner(path), **facts},
        )

    return case


Check = Callable[[System], Iterator[Violation]]
"""A check yields every violation that it finds; it judges only what no other check judges."""

CHECKS: list[tuple[Finding, Check]] = []
"""Every check that asks the manifest alone, with its finding, as the modules of this room add them."""


def check(finding: Finding) -> Callable[[Check], Check]:
    """Add the function below to `CHECKS`: it yields the violations of this kind."""

    def add(judge: Check) -> Check:
        CHECKS.append((finding, judge))
        return judge

    return add


def component_check(finding: Finding) -> Callable[[Callable[[Component], Iterator[Violation]]], Check]:
    """Add the function below to `CHECKS`, to be asked for each component of a system."""
    return lambda judge: check(finding)(lambda system: chain.from_iterable(map(judge, system.components.values())))


def host_check(finding: Finding) -> Callable[[Callable[[Host], Iterator[Violation]]], Check]:
    """Add the function below to `CHECKS`, to be asked for each host of a system."""
    return lambda judge: check(finding)(lambda system: chain.from_iterable(map(judge, system.hosts.values())))


def partition_check(finding: Finding) -> Callable[[Callable[[System, PartitionRequest], Iterator[Violation]]], Check]:
    """Add the function below to `CHECKS`, to be asked for each entry of `partitions`, with the system it stands in."""
    return lambda judge: check(finding)(
        lambda system: chain.from_iterable(judge(system, partition) for partition in system.partitions.values())
    )


def _place(places: Places, path: Path, at_key: bool) -> Place:
    return places.key(*path) if at_key else places.value(*path)


def _owner(path: Path) -> Mapping[str, str]:
    """Kind and name of the entry that a path leads into: `components, vision, cpu` -> `component: vision`."""
    if len(path) < 2 or path[0] not in _ADDRESSED:
        return {}
    return {str(path[0]).removesuffix("s"): str(path[1])}
