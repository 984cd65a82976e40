"""Text that rarms did not write acts neither on a terminal nor on the runner of a workflow."""

import pytest

from rarms_iac.views.harmless import visible


@pytest.mark.parametrize(
    ("text", "shown"),
    [
        ("plain: a::b, C::D and 1:2", "plain: a::b, C::D and 1:2"),
        ("\x1b[31mred", "<U+001B>[31mred"),
        ("a\u202eb", "a<U+202E>b"),
        ("first\n::error::x", "first\n<U+003A>:error::x"),
        ("folded ::set-env name=A::b", "folded <U+003A>:set-env name=A::b"),
        ("##[error]x", "<U+0023>#[error]x"),
    ],
)
def test_what_acts_is_spelt_out(text: str, shown: str) -> None:
    assert visible(text) == shown
