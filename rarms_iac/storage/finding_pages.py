"""The findings' pages: one a code, and so the list of all codes there are."""

import re

from rarms_iac.storage.shipped import shipped

FOLDER = "docs/findings"

_CODE = re.compile(r"RARMS[0-9]{3}")


def known_codes() -> tuple[str, ...]:
    """The code of every finding there is, sorted: each has a page."""
    return tuple(sorted(page.stem for page in shipped(FOLDER).glob("RARMS*.md")))


def finding_page(code: str) -> str | None:
    """The finding's page as it is written, or None where there is none of that code."""
    if not _CODE.fullmatch(code):
        return None
    page = shipped(FOLDER) / f"{code}.md"
    return page.read_text(encoding="utf-8") if page.is_file() else None


def severity_line(page: str) -> str:
    """What the page says of the severity: `warning`, `error`, or `error, can be accepted`."""
    return page.split("\n\n")[1].removeprefix("Severity: ").strip().removesuffix(".")


def may_be_accepted(page: str) -> bool:
    """Whether `policy.accept` may name it: a warning, or an error whose page says so."""
    return severity_line(page) in {"warning", "error, can be accepted"}


def index_of_pages() -> str:
    """`docs/diagnostics.md`: every finding with its severity, summary and page."""
    rows = [_row(code, finding_page(code) or "") for code in known_codes()]
    return "\n".join([_HEAD, *rows]) + "\n"


def _row(code: str, page: str) -> str:
    summary = page.splitlines()[0].removeprefix(f"# {code}: ")
    return f"| [{code}](findings/{code}.md) | {severity_line(page)} | {summary} |"


_HEAD = """\
# Findings

Everything that rarms can tell of, by its stable id. `rarms explain RARMS014` shows a finding's page. How findings are
accepted, and which, says the manifest's `policy.accept`; how they come out, `--output text`, `json`, `sarif`, `junit`
or `github`.

<!-- Made from the pages in docs/findings/ by scripts/findings_index.py; a test compares. -->

| id | severity | summary |
| --- | --- | --- |"""
