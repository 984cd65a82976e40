"""`rarms fmt`: rewrite manifests in the canonical form, comments kept."""

from collections.abc import Sequence

import click

from rarms_iac.app.files import write_file
from rarms_iac.app.manifest_files import FormattedManifest, format_manifests
from rarms_iac.cli.codes import ExitCode
from rarms_iac.cli.options import json_option, manifest_option
from rarms_iac.cli.session import Session, rarms_command
from rarms_iac.manifest.edit.formatting import diff_text
from rarms_iac.storage.reading import STANDARD_INPUT
from rarms_iac.views.as_json import as_json as to_json
from rarms_iac.views.output.common import FmtOutput, FormattedFileOutput


@rarms_command("fmt")
@click.argument("files", nargs=-1, metavar="[FILE]...")
@manifest_option
@click.option("--check", is_flag=True, help="Write nothing; exit code 2 where something would change.")
@click.option("--diff", is_flag=True, help="Write nothing to the files; show what would change.")
@json_option
def command(
    session: Session, *, files: tuple[str, ...], manifest: str, check: bool, diff: bool, as_json: bool
) -> ExitCode:
    """Write manifests and overlays in their canonical form, comments kept.

    FILE is a manifest, an overlay, the folder of a manifest, or - for standard input, which is written to standard
    output; without, it is the one that --manifest names. What a manifest means never changes.
    """
    formatted = format_manifests(files or (manifest,))
    changed = [file for file in formatted if file.changed]
    if diff:
        for file in changed:
            session.terminal.data(diff_text(file.before.decode("utf-8", "replace"), file.after, file.file))
    if not (check or diff):
        _write(session, formatted)
    if as_json:
        outputs = tuple(FormattedFileOutput(file=file.file, changed=file.changed) for file in formatted)
        session.terminal.data(to_json(FmtOutput(files=outputs)))
    elif not diff:
        for file in changed:
            if file.path != STANDARD_INPUT:
                session.terminal.talk(f"{file.file}: {'would be formatted' if check else 'formatted'}")
    return ExitCode.FOUND if check and changed else ExitCode.DONE


def _write(session: Session, formatted: Sequence[FormattedManifest]) -> None:
    for file in formatted:
        if file.path == STANDARD_INPUT:
            session.terminal.data(file.after)
        elif file.changed:
            write_file(file.path, file.after.encode())
