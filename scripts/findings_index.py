"""Write docs/diagnostics.md from the pages in docs/findings/."""

from pathlib import Path

from rarms_iac.storage.shipped import finding_page, known_codes, severity_line

_HEAD = """\
# Findings

All findings by id. `rarms explain RARMS014` shows the page of a finding. `policy.accept` in the manifest accepts
warnings, and errors that can be accepted. `rarms validate`, `rarms plan` and `rarms doctor` write findings as text,
JSON, SARIF, JUnit, annotations of GitHub or Markdown: `--output text`, `json`, `sarif`, `junit`, `github` or
`markdown`.

<!-- scripts/findings_index.py makes this page from docs/findings/; a test compares. -->

| id | severity | summary |
| --- | --- | --- |"""


def index_of_pages() -> str:
    """Return `docs/diagnostics.md`: each finding with its severity, summary and page."""
    rows = [_row(code, finding_page(code) or "") for code in known_codes()]
    return "\n".join([_HEAD, *rows]) + "\n"


def _row(code: str, page: str) -> str:
    summary = page.splitlines()[0].removeprefix(f"# {code}: ")
    return f"| [{code}](findings/{code}.md) | {severity_line(page)} | {summary} |"


if __name__ == "__main__":
    index = Path(__file__).resolve().parent.parent / "docs" / "diagnostics.md"
    index.write_text(index_of_pages(), encoding="utf-8", newline="\n")
