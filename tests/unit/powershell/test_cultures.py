"""Scripts mean the same in every culture: to a Turkish one I and i are two letters, also in 5.1's keys of tables."""

import re

import pytest

from rarms_iac.powershell.templates import PARTS, part_text, read, runtime
from rarms_iac.powershell.tokens import TokenKind, tokens
from tests.twin.values import Table, Unsupported

TEXTS = {
    "runtime": runtime(),
    **{f"part {name}": part_text(name) for name in PARTS},
    "observe": read("observe.ps1"),
    "bootstrap": read("bootstrap.ps1"),
}
templates = pytest.mark.parametrize("name", TEXTS)

BY_CULTURE = re.compile(
    r"-(i?match|i?notmatch|i?like|i?notlike|csplit)|ToLower|ToUpper|ToTitleCase|CompareTo|StartsWith", re.IGNORECASE
)
ORDINAL = {"ToLowerInvariant", "ToUpperInvariant"}


@templates
def test_no_word_of_a_template_depends_on_the_culture(name: str) -> None:
    """`-cmatch` and its like tell case; `-eq`, `-contains` and `-replace` go by the invariant culture."""
    found = [token.text for token in tokens(TEXTS[name]) if token.kind is TokenKind.WORD]

    assert [word for word in found if BY_CULTURE.fullmatch(word) and word not in ORDINAL] == []
    assert not [word for word in found if word.lower().endswith(("tolower", "toupper"))]


@templates
def test_no_number_is_shaped_by_the_culture(name: str) -> None:
    """Holes of `-f` have widths and hexadecimal digits, which are the same everywhere; no N, D or date."""
    texts = [token.text for token in tokens(TEXTS[name]) if token.kind is TokenKind.STRING]
    holes = [hole for text in texts for hole in re.findall(r"\{[0-9]+(?:,-?[0-9]+)?(:[^}]*)?\}", text)]

    assert set(holes) <= {"", ":x4"}
    assert "ToString()" not in TEXTS[name]


@pytest.mark.parametrize("other", ["value:SFIO", "value:sf\u00adio"])
def test_the_stand_in_refuses_a_key_that_a_culture_decides_about(other: str) -> None:
    table = Table([("value:sfio", 1)])

    with pytest.raises(Unsupported):
        table.at(other)
    assert Table([("value:sfio", 1)], ordinal=True).at(other) is None
