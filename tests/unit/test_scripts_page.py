"""docs/scripts.md names the accepted differences between the stand-in and the real PowerShell, and no others."""

from tests.needs import CHECKOUT
from tests.real_powershell.accepted import REASONS


def test_page_of_scripts_names_accepted_differences() -> None:
    page = (CHECKOUT / "docs" / "scripts.md").read_text("utf-8")

    section = page.partition("`tests/real_powershell/accepted.py`")[2].partition("\n| test |")[0]

    assert [line.removeprefix("- ") for line in section.splitlines() if line.startswith("- ")] == list(REASONS)
