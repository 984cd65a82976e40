"""The templates of scripts: loops and finished literals, nothing else (DESIGN section 6)."""

from collections.abc import Mapping
from functools import cache
from typing import TYPE_CHECKING

from rarms_iac.storage.shipped import shipped, shipped_text

if TYPE_CHECKING:
    from jinja2 import Environment

FOLDER = "templates/powershell"


@cache
def _environment() -> "Environment":
    """Made when a script is; a name that a template does not get is an error."""
    from jinja2 import Environment, FileSystemLoader, StrictUndefined

    return Environment(  # noqa: S701 - PowerShell is no HTML: what enters is a literal or a remark already
        loader=FileSystemLoader(str(shipped(FOLDER)), encoding="utf-8"),
        undefined=StrictUndefined,
        trim_blocks=True,
        lstrip_blocks=True,
        keep_trailing_newline=True,
        newline_sequence="\n",
    )


def fill(template: str, values: Mapping[str, object]) -> bytes:
    """The template's text as the bytes of a script: ASCII, CRLF.

    Raises:
        UnicodeEncodeError: something entered that was no literal.
    """
    return as_script(_environment().get_template(template).render(**values))


def as_script(text: str) -> bytes:
    """Text with LF as the bytes of a script."""
    return text.replace("\n", "\r\n").encode("ascii")


def read(name: str) -> str:
    """A template's text as it lies in its file, with LF."""
    return shipped_text(f"{FOLDER}/{name}")
