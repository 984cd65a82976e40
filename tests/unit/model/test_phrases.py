import pytest

from rarms_iac.model.phrases import in_a_row, number


@pytest.mark.parametrize(
    ("words", "row"), [(["a"], "a"), (["a", "b"], "a and b"), (["a", "b", "c"], "a, b and c"), ([43, 45], "43 and 45")]
)
def test_words_stand_in_a_row(words: list[object], row: str) -> None:
    assert in_a_row(words) == row
    assert in_a_row(words, "or") == row.replace("and", "or")


def test_small_numbers_are_words() -> None:
    assert [number(many) for many in (0, 2, 12, 13)] == ["no", "two", "twelve", "13"]
