"""Amounts and shares as they are read and shown: LP first, a per cent with its noun."""

from fractions import Fraction

import pytest

from rarms_iac.model.quantities import (
    NotAQuantity,
    Percent,
    ShareOfHost,
    Unit,
    parse_quantity,
    share_of_host,
    show_amount,
    show_bytes,
    show_processors,
    show_reserve,
)


@pytest.mark.parametrize("text", ["70 %", "70%", "70 % of host"])
def test_a_share_of_a_host_may_say_so(text: str) -> None:
    assert parse_quantity(text, Unit.SHARE, Unit.PROCESSORS) == (Unit.SHARE, Fraction(70))


@pytest.mark.parametrize("text", ["1.4 LP of host", "70 % of HOST", "70 of host", "70 % of host of host"])
def test_nothing_else_is_of_a_host(text: str) -> None:
    with pytest.raises(NotAQuantity):
        parse_quantity(text, Unit.SHARE, Unit.PROCESSORS)


def test_a_share_that_is_of_no_host_does_not_say_so() -> None:
    with pytest.raises(NotAQuantity):
        parse_quantity("70 % of host", Unit.SHARE)


def test_bytes_have_few_digits() -> None:
    assert [show_bytes(size) for size in (33464376 * 1024, 1537 * 2**20, 4 * 2**30, 0, 1500)] == [
        "31.9 GiB",
        "1537 MiB",
        "4 GiB",
        "0 B",
        "1500 B",
    ]


def test_amounts_have_two_decimals_and_shares_say_of_what() -> None:
    assert show_processors(Fraction(11, 3)) == "3.67 LP"
    assert show_reserve(80, 2) == "1.6 LP (80 % of its 2 VPs)"
    assert share_of_host(Fraction(8, 5), 8, "cell") == "20 % of cell"
    assert show_amount(ShareOfHost(Percent(Fraction(70)))) == "70 % of host"
