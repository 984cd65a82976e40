"""The canonical form of a manifest (`rarms fmt`): one way to write it, with its comments and the same meaning.

Two spaces of indentation, LF, the schema's order of keys; flow collections stay on their line while they are
short; quotes only where some YAML would read something else; one space between a number and its unit.
"""

from dataclasses import replace
from difflib import unified_diff

from rarms_iac.manifest.edit.write import KeyTooLong, write_tree
from rarms_iac.manifest.text.events import ParsedText
from rarms_iac.manifest.text.reading import read_text
from rarms_iac.manifest.text.tree import place_of_node
from rarms_iac.model.diagnostics import Diagnostic, Place, has_errors
from rarms_iac.texts.findings import WRONG_VALUE


class CannotFormat(ValueError):
    """The text is not a manifest; `diagnostics` say why, as `rarms validate` would."""

    def __init__(self, diagnostics: tuple[Diagnostic, ...]) -> None:
        super().__init__("; ".join(f"{diagnostic.place}: {diagnostic.detail}" for diagnostic in diagnostics))
        self.diagnostics = diagnostics


def format_text(text: str, file: str) -> str:
    """Return the canonical form of a manifest's or overlay's text; formatting it again changes nothing.

    Raises:
        CannotFormat: the text is not a manifest.
    """
    return format_tree(read_manifest(text, file))


def read_manifest(text: str, file: str = "rarms.yaml") -> ParsedText:
    """Return the text of a manifest or overlay, read.

    Raises:
        CannotFormat: the text is not a manifest.
    """
    parsed = read_text(text.encode("utf-8", errors="surrogatepass"), file, "")
    _check_manifest(parsed)
    return parsed


def _check_manifest(parsed: ParsedText) -> None:
    diagnostics = parsed.diagnostics
    if parsed.readable and not isinstance(parsed.value, dict):
        file, advice = parsed.source.file, "Begin with `schema: rarms/v1`."
        place = Place(file=file, line=1, column=1)
        diagnostics += (WRONG_VALUE.at(place, "A manifest is a map of keys to values.", advice, file=file),)
    if has_errors(diagnostics):
        raise CannotFormat(diagnostics)


def format_tree(parsed: ParsedText) -> str:
    """Return the canonical form of a file that was read already (`reading.read_yaml`).

    Raises:
        CannotFormat: the text is not a manifest.
    """
    _check_manifest(parsed)
    try:
        return write_tree(parsed.tree())
    except KeyTooLong as problem:
        place = replace(place_of_node(problem.key), length=1)
        raise CannotFormat(
            (WRONG_VALUE.at(place, "This key is too long: {reason}.", "Use a shorter name.", reason=str(problem)),)
        ) from None


def diff_text(before: str, after: str, name: str, changed: str = "formatted") -> str:
    """Return an edit as a unified diff; empty where it changes nothing.

    Args:
        before: the text of the file.
    """
    lines = unified_diff(before.splitlines(keepends=True), after.splitlines(keepends=True), name, f"{name} ({changed})")
    return "".join(line if line.endswith("\n") else f"{line}\n\\ No newline at end of file\n" for line in lines)
