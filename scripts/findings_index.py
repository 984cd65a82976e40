"""Writes docs/diagnostics.md anew from the pages in docs/findings/."""

from pathlib import Path

from rarms_iac.storage.finding_pages import finding_page, known_codes, severity_line

_HEAD = """\
# Findings

Everything that rarms can tell of, by its stable id. `rarms explain RARMS014` shows a finding's page. How findings are
accepted, and which, says the manifest's `policy.accept`; how they come out, `--output text`, `json`, `sarif`, `junit`
or `github`.

<!-- Made from the pages in docs/findings/ by scripts/findings_index.py; a test compares. -->

| id | severity | summary |
| --- | --- | --- |"""


def index_of_pages() -> str:
    """`docs/diagnostics.md`: every finding with its severity, summary and page."""
    rows = [_row(code, finding_page(code) or "") for code in known_codes()]
    return "\n".join([_HEAD, *rows]) + "\n"


def _row(code: str, page: str) -> str:
    summary = page.splitlines()[0].removeprefix(f"# {code}: ")
    return f"| [{code}](findings/{code}.md) | {severity_line(page)} | {summary} |"


if __name__ == "__main__":
    index = Path(__file__).resolve().parent.parent / "docs" / "diagnostics.md"
    index.write_text(index_of_pages(), encoding="utf-8", newline="\n")
