"""`rarms fmt`: one way to write a manifest."""

from codecs import BOM_UTF8
from dataclasses import dataclass

import click

from rarms_iac.app.errors import Outcome, UseCaseError
from rarms_iac.app.files import write_file
from rarms_iac.cli.codes import ExitCode
from rarms_iac.cli.options import json_option, manifest_option
from rarms_iac.cli.session import Session, rarms_command
from rarms_iac.manifest.edit.formatting import CannotFormat, diff_text, format_tree
from rarms_iac.manifest.load import manifest_path
from rarms_iac.manifest.text.characters import BYTE_ORDER_MARK
from rarms_iac.manifest.text.reading import STANDARD_INPUT, ParsedText, read
from rarms_iac.model.diagnostics import Diagnostic
from rarms_iac.views.as_json import as_json as to_json
from rarms_iac.views.output.common import FmtOutput, FormattedFileOutput


@dataclass(frozen=True, slots=True, kw_only=True)
class Formatted:
    """A file, and its text before and after."""

    path: str
    file: str  # as messages name it
    before: bytes
    after: str

    @property
    def changed(self) -> bool:
        """Whether it was not in the canonical form; a byte order mark or CRLF counts too."""
        return self.before != self.after.encode()


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
    formatted = _all_formatted(tuple(map(manifest_path, files or (manifest,))))
    changed = [one for one in formatted if one.changed]
    if diff:
        for one in changed:
            session.terminal.data(diff_text(one.before.decode("utf-8", "replace"), one.after, one.file))
    if not (check or diff):
        _write(session, formatted)
    if as_json:
        shown = tuple(FormattedFileOutput(file=one.file, changed=one.changed) for one in formatted)
        session.terminal.data(to_json(FmtOutput(files=shown)))
    elif not diff:
        for one in changed:
            if one.path != STANDARD_INPUT:
                session.terminal.talk(f"{one.file}: {'would be formatted' if check else 'formatted'}")
    return ExitCode.FOUND if check and changed else ExitCode.DONE


def _all_formatted(paths: tuple[str, ...]) -> list[Formatted]:
    """All of them; nothing is written before every one can be.

    Raises:
        UseCaseError: one of them is no manifest.
    """
    done: list[Formatted] = []
    problems: list[Diagnostic] = []
    sources = {}
    for path in paths:
        tree = read(path)
        sources[tree.source.file] = tree.source.lines
        try:
            after = format_tree(tree)
        except CannotFormat as problem:
            problems += problem.diagnostics
            continue
        done.append(Formatted(path=path, file=tree.source.file, before=_as_stored(tree), after=after))
    if problems:
        raise UseCaseError(Outcome.NEGATIVE, problems, sources)
    return done


def _write(session: Session, formatted: list[Formatted]) -> None:
    for one in formatted:
        if one.path == STANDARD_INPUT:
            session.terminal.data(one.after)
        elif one.changed:
            write_file(one.path, one.after.encode())


def _as_stored(parsed: ParsedText) -> bytes:
    """The file's bytes; the reader takes a byte order mark away and notes it."""
    marked = any(diagnostic.code == BYTE_ORDER_MARK.code for diagnostic in parsed.diagnostics)
    return BOM_UTF8 + parsed.source.data if marked else parsed.source.data
