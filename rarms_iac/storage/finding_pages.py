"""The pages of all findings: `docs/findings/RARMS014.md`, a page for each id, and so the list of all ids."""

from rarms_iac.storage.shipped import shipped, shipped_text

FOLDER = "docs/findings"


def known_codes() -> tuple[str, ...]:
    """The code of every finding there is, sorted: each has a page."""
    return tuple(sorted(page.stem for page in shipped(FOLDER).glob("RARMS*.md")))


def finding_page(code: str) -> str | None:
    """The finding's page as it is written, or None where there is none of that code."""
    return shipped_text(f"{FOLDER}/{code}.md") if code in known_codes() else None


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
