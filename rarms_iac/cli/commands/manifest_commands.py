"""Commands about the manifest itself: `rarms init`, `validate` and `fmt`."""

import shlex
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

from rarms_iac.app.files import write_file
from rarms_iac.app.manifest_files import FormattedManifest, format_manifests, write_first_manifest
from rarms_iac.app.manifests import sources_in, validate
from rarms_iac.app.requests import DatedManifestSource, ManifestFile, argument, flag, option
from rarms_iac.cli.command import rarms_command
from rarms_iac.cli.ending import ExitCode
from rarms_iac.cli.messages import OutputOptions, is_shown, write_outputs
from rarms_iac.cli.session import Session
from rarms_iac.manifest.edit.formatting import diff_text
from rarms_iac.manifest.load import manifest_path
from rarms_iac.manifest.text.tree import first_line
from rarms_iac.model.commands import MEASURE, PLAN, prose
from rarms_iac.storage.reading import STANDARD_INPUT
from rarms_iac.views.finding_forms import findings_as
from rarms_iac.views.json_output import json_of


@dataclass(frozen=True, slots=True, kw_only=True)
class InitOptions:
    """Options of `rarms init`."""

    folder: str = argument("[FOLDER]", default=".")
    name: str | None = option("--name", help="The application's name. [default: the name of the folder]")
    tutorial: bool = flag(
        "--tutorial", help="Write the manifest of the tutorial. Its components do not fit on the host at first."
    )


@rarms_command("init")
def init_command(session: Session, options: InitOptions) -> ExitCode:
    """Write a commented rarms.yaml into FOLDER (default: this folder).

    The manifest has two components on a simulated host, which needs no installation. It is ready for `rarms validate`
    and `rarms plan`. rarms creates FOLDER if it does not exist, and never replaces a manifest. Editors check the
    manifest against rarms.schema.json in the same folder. With .gitattributes, git keeps the measurements of both
    branches in a merge.
    """
    written = write_first_manifest(options.folder, options.name, tutorial=options.tutorial)
    if session.as_json:
        session.terminal.data(json_of(written))
    else:
        manifest, schema, attributes = written.files
        session.terminal.tell(f"Wrote {manifest}, {schema} for your editor, and {attributes} for data logs in git.")
        folder = Path(manifest).parent.as_posix()
        enter = "" if folder == "." else f"cd {shlex.quote(folder)}, "
        session.terminal.tell(f"Edit it, then: {enter}rarms validate, rarms measure, rarms plan, rarms apply.")
    return ExitCode.DONE


@dataclass(frozen=True, slots=True, kw_only=True)
class ValidateOptions(OutputOptions):
    """Options of `rarms validate` alone."""

    files: tuple[str, ...] = argument("[FILE]...", default=())
    strict: bool = flag("--strict", help="Also exit with code 2 for warnings.")


@rarms_command("validate")
def validate_command(session: Session, options: ValidateOptions, source: DatedManifestSource) -> ExitCode:
    """Check manifests, and show all findings: first on the structure, then on the values.

    FILE is a manifest, an overlay, a folder with any number of both, or - for standard input. An overlay is checked
    with the rarms.yaml next to it or above it. Without FILE: the manifest of --manifest. rarms does not contact
    a host or start a program. Errors end with exit code 2; warnings and notes do not.
    """
    outputs = options.targets(session)
    named = options.files or (source.manifest,)
    checked = validate(sources_in(named, source))
    write_outputs(
        session.terminal,
        outputs,
        lambda form: findings_as(
            form,
            checked.findings,
            checked.sources,
            places=first_line(manifest_path(named[0])),
            accepted=checked.accepted,
        ),
    )
    if checked.is_missing:
        return ExitCode.USAGE
    if checked.fails(strict=options.strict):
        return ExitCode.FOUND
    if not options.files and is_shown(outputs):
        from rarms_iac.app.declared_hosts import NOT_YET_MEASURED  # loads the planner, so only for a valid manifest

        unmeasured = any(finding.code == NOT_YET_MEASURED.code for finding in (*checked.findings, *checked.accepted))
        session.terminal.tell(prose("Next: ", MEASURE if unmeasured else PLAN))
    return ExitCode.DONE


@dataclass(frozen=True, slots=True, kw_only=True)
class FmtOptions(ManifestFile):
    """Options of `rarms fmt`."""

    files: tuple[str, ...] = argument("[FILE]...", default=())
    check: bool = flag("--check", help="Write nothing; exit with code 2 if a file would change.")
    diff: bool = flag("--diff", help="Show the changes without writing them.")


@rarms_command("fmt")
def fmt_command(session: Session, options: FmtOptions) -> ExitCode:
    """Write manifests and overlays in their canonical form, with their comments.

    FILE is a manifest, an overlay or the folder of a manifest. With -, rarms reads standard input and writes standard
    output. Without FILE: the manifest of --manifest. The meaning of a manifest does not change.
    """
    formatted = format_manifests(options.files or (options.manifest,))
    changed = [file for file in formatted.files if file.changed]
    if options.diff:
        for file in changed:
            session.terminal.data(diff_text(file.before.decode("utf-8", "replace"), file.after, file.file))
    if not (options.check or options.diff):
        _write(session, formatted.files)
    if session.as_json:
        session.terminal.data(json_of(formatted))
    elif not options.diff:
        for file in changed:
            if file.path != STANDARD_INPUT:
                session.terminal.tell(f"{file.file}: {'would be formatted' if options.check else 'formatted'}")
    return ExitCode.FOUND if options.check and changed else ExitCode.DONE


def _write(session: Session, formatted: Sequence[FormattedManifest]) -> None:
    for file in formatted:
        if file.path == STANDARD_INPUT:
            session.terminal.data(file.after)
        elif file.changed:
            write_file(file.path, file.after.encode())
