"""Commands about the manifest itself: `rarms init`, `validate` and `fmt`."""

from collections.abc import Sequence

import click

from rarms_iac.app.files import write_file
from rarms_iac.app.manifest_files import FormattedManifest, format_manifests, write_first_manifest
from rarms_iac.app.requests import ManifestSource
from rarms_iac.app.validation import sources_in, validate
from rarms_iac.cli.ending import ExitCode
from rarms_iac.cli.messages import write_outputs
from rarms_iac.cli.options import json_option, manifest_option, manifest_options, output_option
from rarms_iac.cli.session import Session, rarms_command
from rarms_iac.manifest.edit.formatting import diff_text
from rarms_iac.storage.reading import STANDARD_INPUT
from rarms_iac.views.finding_forms import OutputTarget, findings_as
from rarms_iac.views.json_output import json_of
from rarms_iac.views.output.common import FmtOutput, FormattedFileOutput, WrittenOutput


@rarms_command("init")
@click.argument("folder", default=".")
@click.option("--name", help="The application's name. [default: as the folder]")
@click.option("--tutorial", is_flag=True, help="The manifest of the tutorial: what it asks for does not fit at first.")
@json_option
def init_command(session: Session, *, folder: str, name: str | None, tutorial: bool, as_json: bool) -> ExitCode:
    """Write a commented rarms.yaml into FOLDER (default: here) that validates and plans as it is.

    It describes two components on a simulated host, which needs nothing installed. A FOLDER that is not
    there is made; a manifest that is there stays. rarms.schema.json beside it is what editors check it against.
    """
    paths = write_first_manifest(folder, name, tutorial=tutorial)
    if as_json:
        session.terminal.data(json_of(WrittenOutput(files=paths)))
    else:
        session.terminal.talk(f"Wrote {paths[0]}, and {paths[1]} for your editor.")
        session.terminal.tell("Edit it, then: rarms validate, rarms measure, rarms plan, rarms apply.")
    return ExitCode.DONE


@rarms_command("validate")
@click.argument("files", nargs=-1, metavar="[FILE]...")
@manifest_options
@click.option("--strict", is_flag=True, help="End with exit code 2 for warnings, too.")
@output_option
def validate_command(
    session: Session, *, files: tuple[str, ...], source: ManifestSource, strict: bool, outputs: tuple[OutputTarget, ...]
) -> ExitCode:
    """Check manifests and say everything that is wrong or odd at once.

    FILE is a manifest, an overlay (it is checked with the rarms.yaml beside or above it), a folder with any number of
    both, or - for standard input; without, it is what --manifest names. No host is asked, and no program is started.
    Errors end with exit code 2; warnings and notes do not.
    """
    checked = validate(sources_in(files or (source.manifest,), source))
    write_outputs(
        session.terminal,
        outputs,
        lambda form: findings_as(form, checked.findings, checked.sources, accepted=checked.accepted),
    )
    return ExitCode.FOUND if checked.fails(strict=strict) else ExitCode.DONE


@rarms_command("fmt")
@click.argument("files", nargs=-1, metavar="[FILE]...")
@manifest_option
@click.option("--check", is_flag=True, help="Write nothing; exit code 2 where something would change.")
@click.option("--diff", is_flag=True, help="Write nothing to the files; show what would change.")
@json_option
def fmt_command(
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
        session.terminal.data(json_of(FmtOutput(files=outputs)))
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
