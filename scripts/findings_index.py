"""Writes docs/diagnostics.md anew from the pages in docs/findings/."""

from pathlib import Path

from rarms_iac.storage.finding_pages import index_of_pages

if __name__ == "__main__":
    index = Path(__file__).resolve().parent.parent / "docs" / "diagnostics.md"
    index.write_text(index_of_pages(), encoding="utf-8", newline="\n")
