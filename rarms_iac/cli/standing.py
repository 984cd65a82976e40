"""How far what the manifest asks for is on its hosts, for the report: of those that can be looked at at once."""

from collections.abc import Iterator

from rarms_iac.app.errors import UseCaseError
from rarms_iac.app.hosts import Hosts, last_runs, observe_host, select_hosts
from rarms_iac.app.manifests import Manifest
from rarms_iac.app.report_model import HostStatus
from rarms_iac.app.requests import HostSelection
from rarms_iac.apply.host_drift import drift_of_hosts
from rarms_iac.cli.datalogs import measured_reservations, measurements_of
from rarms_iac.diff.drift import DriftKind, partitions_after_last_run
from rarms_iac.model.diagnostics import has_errors
from rarms_iac.model.system import ProviderKind

SAYS = {
    DriftKind.HOST_CHANGED: "changed on the host",
    DriftKind.NOT_APPLIED: "not applied yet",
    DriftKind.BOTH: "changed on the host, and not applied yet",
    DriftKind.MISSING: "not applied yet",
    DriftKind.REMOVED: "removed from the host",
}


def standings_of(manifest: Manifest) -> tuple[HostStatus, ...]:
    """One a simulated host, by name. NOTE: a report needs no host, and waits for none: others are not asked."""
    hosts = manifest.system.hosts
    names = tuple(sorted(name for name, host in hosts.items() if host.provider is ProviderKind.SIMULATED))
    if not names:
        return ()
    try:
        return tuple(_looked(select_hosts(manifest, HostSelection(hosts=names))))
    except UseCaseError:  # a host's file is damaged, or held: every command that is about hosts says so
        return ()


def _looked(hosts: Hosts) -> Iterator[HostStatus]:
    system, application = hosts.system, hosts.system.application.name
    states = {name: observe_host(hosts.open(name)) for name in hosts.chosen}
    present = {name: partitions_after_last_run(journal, application) for name, journal in last_runs(hosts)}
    reservations = measured_reservations(measurements_of(system, hosts.folder, hosts.manifest.source), states)
    limit = system.policy.max_disruption
    drifts, problems = drift_of_hosts(system, states, hosts.manifest.places, limit, present, reservations)
    if has_errors(problems):
        yield from (HostStatus(host=name, is_planned=False) for name in hosts.chosen)
        return
    for name, drifted in drifts.items():
        if name in hosts.chosen:
            differs = ((str(each.address), SAYS[each.kind]) for each in drifted if each.kind in SAYS)
            yield HostStatus(host=name, differs=tuple(differs))
