"""`rarms prove`: all components together in the applied layout."""

import click

from rarms_iac.app.hosts import Hosts, select_hosts
from rarms_iac.app.manifests import load_manifest
from rarms_iac.app.prove import USUAL_SEED, ProveRequest, prove_layout
from rarms_iac.app.requests import HostSelection, ManifestSource
from rarms_iac.cli.codes import ExitCode
from rarms_iac.cli.messages import TerminalReporter, tell
from rarms_iac.cli.options import host_options, json_option, lock_timeout_option, manifest_options
from rarms_iac.cli.session import Session, rarms_command
from rarms_iac.views.prove import ProofProgress, proof_text, prove_json


@rarms_command("prove")
@manifest_options
@host_options
@click.option("--interference", metavar="NAME", help="Run this load beside them. [default: none]")
@click.option("--samples", type=click.IntRange(min=2), help="So many a component. [default: as `run.until` says]")
@click.option("--seed", type=click.IntRange(min=1), default=USUAL_SEED, help="Draw chance from here. [default: 1]")
@lock_timeout_option
@json_option
def command(
    session: Session,
    *,
    source: ManifestSource,
    host_selection: HostSelection,
    interference: str | None,
    samples: int | None,
    seed: int,
    lock_timeout: int,
    as_json: bool,
) -> ExitCode:
    """Run all components together in the layout that is applied, and show every index beside its threshold.

    What they show is written into the configuration logs. Exit code 4 where a threshold is missed or the samples cannot
    tell; 3 where the manifest asks for something that is not applied yet.
    """
    request = ProveRequest(interference=interference, samples=samples, seed=seed, lock_timeout_ms=lock_timeout)
    return prove_and_show(session, select_hosts(load_manifest(source), host_selection), request, as_json=as_json)


def prove_and_show(session: Session, hosts: Hosts, request: ProveRequest, *, as_json: bool) -> ExitCode:
    """Prove what is applied, and show it; also at the end of `rarms apply --prove`."""
    with ProofProgress(session.terminal.live_table()) as progress:
        outcome = prove_layout(
            hosts, request, reporter=TerminalReporter(session), stop=session.interrupts, listener=progress
        )
    if outcome.stopped:
        session.terminal.tell("Stopped: nothing is proven, and nothing was changed.")
        return session.interrupts.exit_code or ExitCode.INTERRUPTED
    tell(session.terminal, outcome.findings, hosts.manifest.sources)
    if as_json:
        session.terminal.data(prove_json(outcome.proofs, request.interference, outcome.findings))
    else:
        session.terminal.show(proof_text(outcome.proofs, request.interference))
    if outcome.not_proven:
        session.terminal.tell(f"Not proven, since they are on other hosts: {', '.join(outcome.not_proven)}.")
    return ExitCode.NO if outcome.findings else ExitCode.DONE
