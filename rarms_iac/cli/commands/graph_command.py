"""`rarms graph`: hosts, partitions and components as a picture."""

import click

from rarms_iac.app.data_logs import Measurements, measured_reservations, measurements_of
from rarms_iac.app.errors import Outcome, UseCaseError
from rarms_iac.app.manifests import Manifest, load_manifest
from rarms_iac.app.requests import ManifestSource
from rarms_iac.cli.codes import ExitCode
from rarms_iac.cli.options import json_option, manifest_options
from rarms_iac.cli.session import Session, rarms_command
from rarms_iac.model.layout import Layout
from rarms_iac.planner.layout import plan_layout
from rarms_iac.views.graph import GraphFormat, graph_json, graph_nodes, graph_text


@rarms_command("graph")
@manifest_options
@click.option(
    "--format",
    "form",
    type=click.Choice([one.value for one in GraphFormat]),
    default=GraphFormat.MERMAID.value,
    help="The language of the graph. [default: mermaid]",
)
@click.option("--candidates", is_flag=True, help="Draw which components could be combined, and what is known of it.")
@json_option
def command(session: Session, *, source: ManifestSource, form: str, candidates: bool, as_json: bool) -> ExitCode:
    """Draw which component runs in which partition on which host, as the manifest alone places them.

    With --candidates: the components whose reservations are measured, and every compound of them that could reserve
    less than its parts; what one will probably need is marked "predicted" until it is measured. Needs no host.
    Mermaid is drawn by GitHub and GitLab; DOT by Graphviz: rarms graph --format dot | dot -Tsvg.
    """
    manifest = load_manifest(source)
    system = manifest.system
    if candidates:
        return _candidates(session, measurements_of(manifest), manifest, form, as_json=as_json)
    reservations = measured_reservations(measurements_of(manifest), {})
    planning = plan_layout(system, reservations, {}, manifest.places)
    if not isinstance(planning.answer, Layout):
        raise UseCaseError(Outcome.NEGATIVE, planning.findings, manifest.sources)
    name, nodes = system.application.name, graph_nodes(system, planning.answer)
    session.terminal.data(graph_json(name, nodes) if as_json else graph_text(GraphFormat(form), name, nodes))
    return ExitCode.DONE


def _candidates(session: Session, measured: Measurements, manifest: Manifest, form: str, *, as_json: bool) -> ExitCode:
    from rarms_iac.app.candidates import candidates_in
    from rarms_iac.planner.combining.candidates import nodes_of as candidate_nodes
    from rarms_iac.views.graph import candidates_json, candidates_text

    drawn = candidates_in(measured, manifest)
    name, nodes = measured.system.application.name, candidate_nodes(drawn.candidates, drawn.predicted)
    session.terminal.data(candidates_json(name, nodes) if as_json else candidates_text(GraphFormat(form), name, nodes))
    return ExitCode.DONE
