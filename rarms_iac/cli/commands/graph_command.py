"""`rarms graph`: hosts, partitions and components as a picture."""

import click

from rarms_iac.app.graph import candidate_nodes, layout_of_manifest
from rarms_iac.app.manifests import load_manifest
from rarms_iac.app.requests import ManifestSource
from rarms_iac.cli.codes import ExitCode
from rarms_iac.cli.options import json_option, manifest_options
from rarms_iac.cli.session import Session, rarms_command
from rarms_iac.views.graph import candidates_json, candidates_text, graph_json, graph_nodes, graph_text


@rarms_command("graph")
@manifest_options
@click.option("--candidates", is_flag=True, help="Draw which components could be combined, and what is known of it.")
@json_option
def command(session: Session, *, source: ManifestSource, candidates: bool, as_json: bool) -> ExitCode:
    """Draw which component runs in which partition on which host, as the manifest alone places them.

    With --candidates: the components whose reservations are measured, and every compound of them that could reserve
    less than its parts; what a compound will probably need is marked "predicted" until it is measured. Needs no host.
    The picture is in Mermaid, which GitHub and GitLab draw in a page or a pull request.
    """
    manifest = load_manifest(source)
    name = manifest.system.application.name
    if candidates:
        nodes = candidate_nodes(manifest, predict=True)
        text = candidates_json(name, nodes) if as_json else candidates_text(name, nodes)
    else:
        placed = graph_nodes(manifest.system, layout_of_manifest(manifest))
        text = graph_json(name, placed) if as_json else graph_text(name, placed)
    session.terminal.data(text)
    return ExitCode.DONE
