"""Values that the parts of a comparison share: the manifest's rules, the managed machines, and one part's result."""

from collections.abc import Callable, Collection, Mapping
from dataclasses import dataclass, field

from rarms_iac.model.changes import Address, Change
from rarms_iac.model.commands import command, prose
from rarms_iac.model.diagnostics import Diagnostic, Finding, Place
from rarms_iac.model.renaming import renaming
from rarms_iac.model.state import Partition, State

NOTHING_TO_MOVE = Finding.warning("RARMS156", "Both names of a move exist on the host")


def no_place(_address: Address) -> Place | None:
    """Stand in for a locator where no manifest line asks for anything.

    Returns:
        None, for every address.
    """
    return None


@dataclass(frozen=True, slots=True, kw_only=True)
class ManifestRules:
    """The rules of the manifest beside the desired state."""

    moved: Mapping[str, str] = field(default_factory=dict)  # old partition name -> new
    protected: frozenset[str] = frozenset()  # partitions that must not be removed
    replaceable: frozenset[str] = frozenset()  # shipped task classes that may be replaced, in lower case
    unused: frozenset[str] = frozenset()  # managed partitions that the manifest no longer names: stopped, not removed
    unnamed: frozenset[str] = frozenset()  # all partitions of the host that it no longer names
    locate: Callable[[Address], Place | None] = no_place  # the manifest line that asks for what is at an address


@dataclass(slots=True)
class PartialDifference:
    """Gathers the changes of one kind of resource while it is walked."""

    changes: list[Change] = field(default_factory=list)
    unused: list[str] = field(default_factory=list)
    findings: list[Diagnostic] = field(default_factory=list)
    unchanged: int = 0


@dataclass(frozen=True, slots=True, kw_only=True)
class ManagedMachines:
    """The machines that carry this application's mark, after the manifest's moves."""

    application: str
    machines: Mapping[str, Partition]  # by the partition name that each is to have
    new_names: Mapping[str, str]  # by the name that each has now
    findings: tuple[Diagnostic, ...]  # moves that cannot be done


def managed_machines(
    observed: State, application: str, wanted: Collection[str], rules: ManifestRules
) -> ManagedMachines:
    """Find the machines with this application's mark and give each the name that the manifest's moves give it.

    Args:
        application: whose marks count.
        wanted: names of the desired partitions; a move happens only onto one of them.
        rules: the manifest's moves, and the lines that ask for them.

    Returns:
        The machines by their new names, the new name of each old one, and a finding for each move that finds its
            name taken.
    """
    marked = {partition.mark.name: partition for partition in observed.of(application).partitions if partition.mark}
    names = renaming(marked, wanted, rules.moved)
    return ManagedMachines(
        application=application,
        machines={names.new[name]: partition for name, partition in sorted(marked.items())},
        new_names=names.new,
        findings=tuple(
            NOTHING_TO_MOVE.at(
                rules.locate(Address(partition=old)),
                "`moved` calls {old:quoted} now {new:quoted}, but the host has a partition of each name.",
                prose(
                    "Remove one of them (",
                    command("destroy", target=f"partition/{old}"),
                    "), or take the line out of `moved`.",
                ),
                address=f"partition/{old}",
                old=old,
                new=rules.moved[old],
            )
            for old in names.impossible
            if old in rules.moved
        ),
    )
