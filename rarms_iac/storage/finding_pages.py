"""The pages of the findings, which are shipped: which codes there are, and what each page says of its severity."""

from dataclasses import dataclass
from typing import Literal

from rarms_iac.storage.shipped import shipped, shipped_text

FOLDER = "docs/findings"


def known_codes() -> tuple[str, ...]:
    """Return the code of every finding there is, sorted: each has a page."""
    return tuple(sorted(page.stem for page in shipped(FOLDER).glob("RARMS*.md")))


@dataclass(frozen=True, slots=True, kw_only=True)
class FindingPage:
    """What a finding means and how to mend it."""

    kind: Literal["explanation"] = "explanation"
    subject: str  # its code
    page: str  # Markdown


def finding_page(code: str) -> str | None:
    """Return the finding's page as it is written, or None where there is none of that code.

    Args:
        code: such as `RARMS014`.

    Returns:
        Markdown.
    """
    return shipped_text(f"{FOLDER}/{code}.md") if code in known_codes() else None


def severity_line(page: str) -> str:
    """Return what the page says of the severity: `warning`, `error`, or `error, can be accepted`.

    Returns:
        The words as the page has them.
    """
    return page.split("\n\n")[1].removeprefix("Severity: ").strip().removesuffix(".")


def may_be_accepted(page: str) -> bool:
    """Whether `policy.accept` may name it: a warning, or an error whose page says so.

    Returns:
        False: an acceptance of it is refused.
    """
    return severity_line(page) in {"warning", "error, can be accepted"}


def is_code(subject: str) -> bool:
    """Whether a finding is meant: a number, with or without its letters.

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
