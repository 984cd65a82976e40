"""YAML 1.2 core scalars."""

from typing import Any

import pytest

from rarms_iac.manifest.text.scalars import NotRepresentable, plain_scalar


@pytest.mark.parametrize(
    ("text", "value"),
    [
        *[(word, word) for word in ("no", "yes", "on", "off", "y", "N", "nO", "2027-01-31", "1_000", "0b1", "12:30")],
        *[
            (word, word)
            for word in ("88 ms", "1.4 LP", "１２", "٣", "+", "-", ".", "0x", "0o8", "nul", "truE", "1e", "é")
        ],
        *[(word, None) for word in ("", "~", "null", "Null", "NULL")],
        *[(word, True) for word in ("true", "True", "TRUE")],
        *[(word, False) for word in ("false", "False", "FALSE")],
        *[("0640", 640), ("-7", -7), ("+7", 7), ("0o17", 15), ("0xfF", 255), ("007", 7), ("0" * 30 + "1", 1)],
        *[("1.5", 1.5), (".5", 0.5), ("1e3", 1000), ("2.0", 2), ("-0.0", 0), ("1e300", 1e300), ("1.", 1)],
    ],
)
def test_plain_word_means_what_yaml_1_2_says(text: str, value: Any) -> None:
    found = plain_scalar(text)

    assert (type(found), found) == (type(value), value)


@pytest.mark.parametrize(
    "text", ["9" * 16, "-" + "9" * 5000, "0x" + "f" * 16, "1e999", ".inf", "-.Inf", ".nan", ".NaN"]
)
def test_what_cannot_be_kept_is_refused(text: str) -> None:
    with pytest.raises(NotRepresentable):
        plain_scalar(text)
