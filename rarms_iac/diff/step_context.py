"""What a comparison of a host and its steps depend on: the host, its capacity, its claims, and the manifest's rules."""

from collections.abc import Callable, Collection, Iterable, Mapping
from dataclasses import dataclass, field

from rarms_iac.model.capacity import fits
from rarms_iac.model.changes import Address, Change
from rarms_iac.model.claims import Claim
from rarms_iac.model.commands import command, prose
from rarms_iac.model.diagnostics import Diagnostic, Place
from rarms_iac.model.layout import Making
from rarms_iac.model.names import renaming
from rarms_iac.model.quantities import Milliseconds
from rarms_iac.model.seen_host import SeenHost
from rarms_iac.model.state import Disk, Partition, RunState, Starting, State, TaskClass
from rarms_iac.model.system import Disruption
from rarms_iac.texts.findings import Finding


@dataclass(frozen=True, slots=True, kw_only=True)
class StepContext:
    """The host before the first step, and what its steps depend on besides the changes."""

    seen: SeenHost
    guest_builds: Mapping[str, int] = field(default_factory=dict)  # by id of a machine: of its Windows; absent: unknown
    making: Mapping[str, Making] = field(default_factory=dict)  # by partition: what only its making needs
    criticality: Mapping[str, int] = field(default_factory=dict)  # by partition: the highest of its members'
    disks: Mapping[str, tuple[Disk, ...]] = field(default_factory=dict)  # by id of a machine: those that go with it
    attached: Mapping[str, int] = field(default_factory=dict)  # by id of a machine: how many disks it has
    # By id of a machine that holds nothing that could be lost: rarms' task classes in its guest.
    restorable: Mapping[str, tuple[TaskClass, ...]] = field(default_factory=dict)
    graces: Mapping[str, Milliseconds] = field(default_factory=dict)  # by partition: for its guest to shut down
    max_disruption: Disruption = Disruption.HOST_RESTART
    starting: Mapping[str, Starting] = field(default_factory=dict)  # by partition that reserves more while it starts
    remaining: Mapping[str, str] = field(default_factory=dict)  # by partition: why it is not made here

    def fits(self, claims: Iterable[Claim]) -> bool:
        """Tell whether these claims of managed partitions fit the host together with the foreign ones.

        It is False also if it is unknown whether virtual processors find logical ones (`model.capacity.fits`).
        """
        return fits(self.seen.capacity, (*self.seen.claims, *claims))

    def rank(self, partition: str) -> tuple[int, str]:
        """Return criticality, 0 if it is not known, and name: the least critical is sorted first."""
        return self.criticality.get(partition, 0), partition


NOTHING_TO_MOVE = Finding.warning("RARMS156", "Both names of a move exist on the host")


def no_place(_address: Address) -> Place | None:
    """Stand in for a locator where no manifest line asks for anything.

    Returns:
        None, for every address.
    """
    return None


@dataclass(frozen=True, slots=True, kw_only=True)
class ManifestRules:
    """The rules of the manifest apart from the desired state."""

    moved: Mapping[str, str] = field(default_factory=dict)  # old partition name -> new
    protected: frozenset[str] = frozenset()  # partitions that must not be removed
    replaceable: frozenset[str] = frozenset()  # shipped task classes that may be replaced, in lower case
    unused: frozenset[str] = frozenset()  # managed partitions that the manifest no longer names: stopped, not removed
    unnamed: frozenset[str] = frozenset()  # all partitions of the host that it no longer names
    locate: Callable[[Address], Place | None] = no_place  # the manifest line that asks for what is at an address


@dataclass(slots=True)
class Difference:
    """The changes of a host, or of one kind of its resources, and the findings that stand in the way."""

    changes: list[Change] = field(default_factory=list)  # of a host by address
    unused: list[str] = field(default_factory=list)  # partitions only listed: stopped already, automatic start off
    findings: list[Diagnostic] = field(default_factory=list)
    unchanged: int = 0  # resources that are as wanted; unused partitions are not counted


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
                "`moved` renames {old:quoted} to {new:quoted}, but the host has both.",
                prose(
                    "Remove one of them (",
                    command("destroy", target=f"partition/{old}"),
                    "), or remove the line from `moved`.",
                ),
                address=f"partition/{old}",
                old=old,
                new=rules.moved[old],
            )
            for old in names.impossible
            if old in rules.moved
        ),
    )


NO_CLAIM = Claim()

_ACTIVE = frozenset({RunState.RUNNING, RunState.PAUSED, RunState.BUSY, RunState.CRITICAL})


def claim_of(partition: Partition | None) -> Claim:
    """Return the present promise to a managed partition.

    Nothing before it runs, because a reserve is taken at the start (windows.md 1.2). A partition that merely starts
    with its host counts when it is started; the layout has room for all of them.

    Args:
        partition: as observed; None: there is none.

    Returns:
        Virtual processors, reserve (per cent of each) and memory (bytes).
    """
    if partition is None or not (partition.settings.running or partition.state in _ACTIVE):
        return NO_CLAIM
    return partition.claim


def within(claim: Claim, limit: Claim) -> bool:
    """Tell whether a claim fits in every place where the limit fits.

    Returns:
        True where the claim is at most the limit in every respect; processors count only with a reserve.
    """
    reserved = claim.reserve == 0 or (claim.processors <= limit.processors and claim.reserve <= limit.reserve)
    return reserved and claim.memory <= limit.memory
