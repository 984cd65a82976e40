"""Tables keep to the terminal: first between words, then within names; nothing of a cell is lost."""

import pytest

from rarms_iac.views.table import table

ROWS = [
    ("component", "threshold", "CR", "verdict"),
    ("people-detection", "mean_response_time at most 110 ms", "58 %", "enough (wrong in at most 1 %), 57 % is not"),
    ("navigation", "success_rate at least 95 %", "7 %", "not resolved; a plan reserves 8 %, interpolated"),
]


@pytest.mark.parametrize("width", [40, 60, 80, 120])
def test_no_line_is_wider_than_the_terminal_and_every_word_is_there(width: int) -> None:
    text = table(ROWS, width)

    assert max(map(len, text.splitlines())) <= width
    letters = sorted(text.replace(" ", "").replace("\n", ""))
    assert letters == sorted("".join("".join(row) for row in ROWS).replace(" ", ""))


def test_where_there_is_room_a_row_is_a_line() -> None:
    first, second, third = table(ROWS, 120).splitlines()

    assert first.split() == ["component", "threshold", "CR", "verdict"]
    assert second.index("mean") == third.index("success") == first.index("threshold")


def test_a_number_is_not_parted_from_its_unit_and_a_name_breaks_after_its_hyphens() -> None:
    assert table([("path-following+stock-messages", "at most 100 ms")], 28) == (
        "path-following+       at\nstock-messages        most\n                      100 ms\n"
    )
