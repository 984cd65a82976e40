"""`rarms drift`: who moved, the host or the manifest?"""

from rarms_iac.app.errors import UseCaseError
from rarms_iac.app.hosts import last_runs, observe_hosts, select_hosts
from rarms_iac.app.manifests import load_manifest
from rarms_iac.app.requests import HostSelection, ManifestSource, PlanLimits
from rarms_iac.apply.host_drift import drift_of_hosts
from rarms_iac.apply.prepare import prepare
from rarms_iac.cli.codes import ExitCode
from rarms_iac.cli.options import host_or_snapshot_options, json_option, manifest_options
from rarms_iac.cli.planning import Wish, outcome_of, request_of
from rarms_iac.cli.session import Session, rarms_command
from rarms_iac.diff.drift import DriftKind, partitions_after_last_run
from rarms_iac.model.diagnostics import has_errors
from rarms_iac.model.system import Disruption
from rarms_iac.views.hosts import HostDrift, drift_json, drift_text


@rarms_command("drift")
@manifest_options
@host_or_snapshot_options
@json_option
def command(session: Session, *, source: ManifestSource, where: HostSelection, as_json: bool) -> ExitCode:
    """Tell what somebody changed on the hosts, and what is not applied yet. Only reads.

    Exit code 2 where a host was changed, 5 where something is only not applied yet, 0 where there is neither.
    """
    manifest = load_manifest(source)
    system = manifest.system
    hosts = select_hosts(manifest, where)
    states = observe_hosts(hosts)
    limit = system.policy.max_disruption
    journals = dict(last_runs(hosts))
    present = {name: partitions_after_last_run(journal, system.application.name) for name, journal in journals.items()}
    request = request_of(hosts, Wish(limits=PlanLimits(max_disruption=Disruption.REMOVAL)), states)
    drifts, problems = drift_of_hosts(system, states, manifest.places, limit, present, request.reservations)
    if not drifts and has_errors(problems):
        raise UseCaseError(outcome_of(problems), problems, manifest.sources)
    # The changes say what differs, attribute by attribute; nothing is held back, so that all of them are there.
    plan = prepare(request, states).plan
    changes = {
        (part.host.name, change.address): change for part in (plan.hosts if plan else ()) for change in part.changes
    }
    shown = [
        HostDrift(
            facts=states[name].facts,
            drifted=drifted,
            changes={address: change for (host, address), change in changes.items() if host == name},
        )
        for name, drifted in drifts.items()
        if name in hosts.chosen
    ]
    name = system.application.name
    if as_json:
        session.terminal.data(drift_json(name, shown))
    else:
        session.terminal.show(drift_text(shown))
    for host, journal in journals.items():
        if journal is None or not journal.unfinished:
            continue
        says = f"{host}: a run of plan {journal.started.plan} is unfinished; what it has yet to do is told as changed."
        session.terminal.talk(says)
    return code_of([one.kind for host in shown for one in host.drifted])


def code_of(kinds: list[DriftKind]) -> ExitCode:
    """What the exit code says of these."""
    if any(kind.is_of_the_host for kind in kinds):
        return ExitCode.FOUND
    return ExitCode.NOT_APPLIED if any(kind is not DriftKind.UNUSED for kind in kinds) else ExitCode.DONE
