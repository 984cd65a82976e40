"""Another tool at a simulated host: changes a partition there as a person with Hyper-V's own tools would."""

from collections.abc import Iterator
from dataclasses import dataclass
from typing import Literal

from rarms_iac.app.hosts import Hosts, hold_hosts, host_errors
from rarms_iac.app.planning import hosts_with_partition, refuse_unknown_partitions
from rarms_iac.app.requests import argument, flag, option
from rarms_iac.app.use_case_errors import RequestError
from rarms_iac.diff.readings import resolve
from rarms_iac.model.host import ProviderKind
from rarms_iac.model.operations import Operation, RemovePartition, StartPartition, StopPartition, set_to
from rarms_iac.model.plan import Scope
from rarms_iac.model.state import PartitionSettings
from rarms_iac.providers.interface import StepwiseHost


@dataclass(frozen=True, slots=True, kw_only=True)
class IntruderChange:
    """A change of a partition by another tool; nothing is written into marks or journal."""

    event: Literal["change"] = argument()
    partition: str = argument()
    reserve: int | None = option(
        "--reserve", metavar="PERCENT", least=0, most=100, help="Set this reserve, in per cent of each processor."
    )
    running: bool | None = option("--on/--off", help="Start the partition, or turn it off.")
    is_removed: bool = flag("--remove", help="Turn the partition off and remove it.")


def change_behind_rarms(hosts: Hosts, change: IntruderChange) -> str:
    """Change a partition of the application on its simulated host, for `drift` and `plan` to find.

    Args:
        hosts: the chosen ones; the partition is looked for on those that are simulated.
        change: what is done, at once.

    Returns:
        The name of the host.

    Raises:
        RequestError: nothing is to be changed, no chosen host is simulated, or none of those has the partition.
        UseCaseError: the host refuses it or is held (refused or failed).
    """
    hosts = _simulated(hosts)
    refuse_unknown_partitions(hosts, [change.partition])
    (name,) = hosts_with_partition(hosts, change.partition).chosen
    host = hosts.open(name)
    assert isinstance(host, StepwiseHost), "every simulated host is one"
    scope = Scope(application=hosts.system.application.name, plan="")
    with hold_hosts((host,), 0), host_errors():
        (machine,) = resolve(host.observe().partitions, change.partition, scope)
        operations = list(_operations(change, machine.settings))
        if not operations:
            raise RequestError("Give a change: --reserve PERCENT, --off, --on or --remove.")
        for operation in operations:
            host.execute(operation, scope)
    return name


def _simulated(hosts: Hosts) -> Hosts:
    """Return the chosen hosts that are simulated: no other is looked at."""
    names = [name for name in hosts.chosen if hosts.system.hosts[name].provider is ProviderKind.SIMULATED]
    if not names:
        raise RequestError(
            f"None of the chosen hosts is simulated: {', '.join(hosts.chosen)}. Change a real host with its own tools."
        )
    return hosts.only(*names)


def _operations(change: IntruderChange, now: PartitionSettings) -> Iterator[Operation]:
    name = change.partition
    if change.reserve is not None:
        yield set_to(name, reserve=change.reserve, limit=now.limit, weight=now.weight)
    if change.is_removed or change.running is False:
        yield StopPartition(partition=name, grace_ms=0)
    if change.is_removed:
        yield RemovePartition(partition=name)
    elif change.running:
        yield StartPartition(partition=name)
