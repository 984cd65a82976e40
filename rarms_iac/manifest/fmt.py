"""The canonical form of a manifest (`rarms fmt`): one way to write it, comments kept, its meaning untouched.

Two spaces of indentation, LF, the order of `formatting/shape.py`; flow collections stay on their line while they
are short; quotes only where some YAML would read something else; one space between a number and its unit.
"""

from difflib import unified_diff

from rarms_iac.manifest.formatting.build import CannotFormat, build_tree, unified
from rarms_iac.manifest.formatting.write import write_tree

__all__ = ["CannotFormat", "diff_text", "format_text"]


def format_text(text: str, file: str) -> str:
    """The canonical form of a manifest's or overlay's text; formatting it again changes nothing.

    Raises:
        CannotFormat: the text is no manifest; its message begins with `file:line:column`.
    """
    plain = unified(text)
    return write_tree(build_tree(plain, file), plain)


def diff_text(before: str, after: str, name: str) -> str:
    """What formatting changes, as a unified diff; empty where nothing does."""
    lines = unified_diff(before.splitlines(keepends=True), after.splitlines(keepends=True), name, f"{name} (formatted)")
    return "".join(line if line.endswith("\n") else f"{line}\n\\ No newline at end of file\n" for line in lines)
