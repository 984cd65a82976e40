"""`rarms graph`: hosts, partitions and components as a picture."""

import click

from rarms_iac.app.graph import candidate_nodes, layout_of_manifest
from rarms_iac.app.manifests import load_manifest
from rarms_iac.app.requests import ManifestSource
from rarms_iac.cli.codes import ExitCode
from rarms_iac.cli.options import json_option, manifest_options
from rarms_iac.cli.session import Session, rarms_command
from rarms_iac.views.graph import GraphFormat, candidates_json, candidates_text, graph_json, graph_nodes, graph_text


@rarms_command("graph")
@manifest_options
@click.option(
    "--format",
    "form",
    type=click.Choice([language.value for language in GraphFormat]),
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
    name, language = manifest.system.application.name, GraphFormat(form)
    if candidates:
        nodes = candidate_nodes(manifest, predict=True)
        text = candidates_json(name, nodes) if as_json else candidates_text(language, name, nodes)
    else:
        placed = graph_nodes(manifest.system, layout_of_manifest(manifest))
        text = graph_json(name, placed) if as_json else graph_text(language, name, placed)
    session.terminal.data(text)
    return ExitCode.DONE
