"""Finds what is shipped next to the code: schemas, manifests, templates and the findings' pages.

A finding's page says which severity it has, and whether a policy may accept it.
"""

from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Literal

SHIPPED = ("docs/findings", "locked-requirements.txt", "manifests", "schemas", "templates")
"""What lies next to the package in the checkout and travels in a wheel, as `pyproject.toml` says."""

_PACKAGE = Path(__file__).resolve().parent.parent


class NotShipped(FileNotFoundError):
    """This copy of rarms lacks one of its own files: it was not installed whole."""

    def __init__(self, relative: str) -> None:
        super().__init__(f"the file {relative} of rarms is missing: install rarms again")
        self.relative = relative


def shipped(relative: str) -> Path:
    """Return the path of a shipped file or folder, e.g. `docs/findings`: in the wheel, else in the checkout.

    Args:
        relative: path with `/`, as in the checkout.

    Returns:
        A path that exists.

    Raises:
        NotShipped: it lies in neither.
    """
    for root in (_PACKAGE / "shipped", _PACKAGE.parent):
        found = root / relative
        if found.exists():
            return found
    raise NotShipped(relative)


def shipped_text(relative: str) -> str:
    """Return the text of a shipped file, with LF on every system.

    Returns:
        UTF-8, decoded.

    Raises:
        NotShipped: it lies in neither place.
    """
    return shipped(relative).read_text(encoding="utf-8")


def shipped_files() -> Iterator[tuple[str, bytes]]:
    """Go through all files of this copy of rarms, as they lie in a wheel for any machine.

    What was compiled for this machine is left out: another one may have another processor.

    Yields:
        The path in the wheel, with `/`, and the content.

    Raises:
        NotShipped: a shipped folder is missing.
    """
    roots = [(_PACKAGE, "rarms_iac"), *((shipped(name), f"rarms_iac/shipped/{name}") for name in SHIPPED)]
    for root, name in roots:
        for path in [root] if root.is_file() else sorted(root.rglob("*")):
            relative = path.relative_to(root).parts
            in_wheel = "/".join((name, *relative))
            is_twice = root == _PACKAGE and relative[0] == "shipped"
            is_hidden = "__pycache__" in relative or any(part.startswith(".") for part in relative)
            is_compiled = path.suffix in {".so", ".pyd"}
            if path.is_file() and not (is_twice or is_hidden or is_compiled):
                yield in_wheel, path.read_bytes()


def shipped_module(relative: str) -> str:
    """Return the text of a module of rarms.

    Args:
        relative: path with `/` below the package.
    """
    return (_PACKAGE / relative).read_text(encoding="utf-8")


FOLDER = "docs/findings"


def known_codes() -> tuple[str, ...]:
    """Return the code of every finding there is, sorted: each has a page."""
    return tuple(sorted(page.stem for page in shipped(FOLDER).glob("RARMS*.md")))


@dataclass(frozen=True, slots=True, kw_only=True)
class FindingPage:
    """The meaning of a finding, and its resolution."""

    kind: Literal["explanation"] = "explanation"
    subject: str  # its code
    page: str  # Markdown


def finding_page(code: str) -> str | None:
    """Return the finding's page as it is written, or None where there is none of that code.

    Returns:
        Markdown.
    """
    return shipped_text(f"{FOLDER}/{code}.md") if code in known_codes() else None


def severity_line(page: str) -> str:
    """Return the severity as the page says it: `warning`, `error`, or `error, can be accepted`.

    Returns:
        The words as the page has them.
    """
    return page.split("\n\n")[1].removeprefix("Severity: ").strip().removesuffix(".")


def may_be_accepted(page: str) -> bool:
    """Return whether `policy.accept` may name it: a warning, or an error whose page says so.

    Returns:
        False: an acceptance of it is refused.
    """
    return severity_line(page) in {"warning", "error, can be accepted"}


def is_code(subject: str) -> bool:
    """Return whether a finding is meant: a number, with or without its letters.

    Returns:
        False: it may be the name of a component; whether there is such a finding is not looked at.
    """
    number = subject.upper().removeprefix("RARMS")
    return number.isascii() and number.isdecimal()


def code_of(finding: str) -> str:
    """Return the code that is meant: `14`, `rarms14` and `RARMS014` are one.

    Returns:
        The code in full; another text in capitals.
    """
    number = finding.upper().removeprefix("RARMS")
    return f"RARMS{number:0>3}" if number.isascii() and number.isdecimal() else finding.upper()
