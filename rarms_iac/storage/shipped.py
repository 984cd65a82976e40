"""Finds what is shipped beside the code: schemas, manifests, templates, and the findings' pages with all their ids."""

from pathlib import Path

_PACKAGE = Path(__file__).resolve().parent.parent


class NotShipped(FileNotFoundError):
    """This copy of rarms lacks one of its own files: it was not installed whole."""

    def __init__(self, relative: str) -> None:
        super().__init__(f"rarms lacks its own file {relative}: install it again")
        self.relative = relative


def shipped(relative: str) -> Path:
    """Where a shipped file or folder lies, e.g. `docs/findings`: inside the wheel, else in the checkout.

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
    """The text of a shipped file, with LF on every system.

    Args:
        relative: as of `shipped`.

    Returns:
        UTF-8, decoded.

    Raises:
        NotShipped: it lies in neither place.
    """
    return shipped(relative).read_text(encoding="utf-8")


FOLDER = "docs/findings"


def known_codes() -> tuple[str, ...]:
    """Return the code of every finding there is, sorted: each has a page."""
    return tuple(sorted(page.stem for page in shipped(FOLDER).glob("RARMS*.md")))


def finding_page(code: str) -> str | None:
    """The finding's page as it is written, or None where there is none of that code.

    Args:
        code: such as `RARMS014`.

    Returns:
        Markdown.
    """
    return shipped_text(f"{FOLDER}/{code}.md") if code in known_codes() else None


def severity_line(page: str) -> str:
    """What the page says of the severity: `warning`, `error`, or `error, can be accepted`.

    Args:
        page: of a finding.

    Returns:
        The words as the page has them.
    """
    return page.split("\n\n")[1].removeprefix("Severity: ").strip().removesuffix(".")


def may_be_accepted(page: str) -> bool:
    """Whether `policy.accept` may name it: a warning, or an error whose page says so.

    Args:
        page: of a finding.

    Returns:
        False: an acceptance of it is refused.
    """
    return severity_line(page) in {"warning", "error, can be accepted"}


def is_code(subject: str) -> bool:
    """Whether a finding is meant: a number, with or without its letters.

    Args:
        subject: what a user wrote.

    Returns:
        False: it may be the name of a component; whether there is such a finding is not looked at.
    """
    number = subject.upper().removeprefix("RARMS")
    return number.isascii() and number.isdecimal()


def code_of(finding: str) -> str:
    """The code that is meant: `14`, `rarms14` and `RARMS014` are one.

    Args:
        finding: what a user wrote.

    Returns:
        The code in full; another text in capitals.
    """
    number = finding.upper().removeprefix("RARMS")
    return f"RARMS{number:0>3}" if number.isascii() and number.isdecimal() else finding.upper()
