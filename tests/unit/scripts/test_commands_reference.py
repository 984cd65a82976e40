from pathlib import Path

import pytest

from scripts.commands_reference import reference

PAGE = Path(__file__).parents[3] / "docs" / "commands.md"


@pytest.mark.skipif(not PAGE.parent.is_dir(), reason="the documentation is not beside these tests")
def test_page_of_commands_is_what_commands_say() -> None:
    assert PAGE.read_text(encoding="utf-8") == reference(), (
        "run: python -m scripts.commands_reference > docs/commands.md"
    )
