"""Amounts and shares as they are shown: LP first, a per cent with its noun."""

from fractions import Fraction

from hypothesis import given
from hypothesis import strategies as st

from rarms_iac.model.quantities import LogicalProcessors, Percent, ProcessorTime, ShareOfHost, Unit, parse_quantity
from rarms_iac.texts.quantities import (
    share_of_host,
    show_amount,
    show_bytes,
    show_processors,
    show_reserve,
    write_bytes,
)


def test_bytes_have_few_digits() -> None:
    sizes = (33464376 * 1024, 3584 * 2**20, 1537 * 2**20, 4 * 2**30, 512 * 2**20, 1500, 0)
    assert list(map(show_bytes, sizes)) == ["31.9 GiB", "3.5 GiB", "1.5 GiB", "4 GiB", "512 MiB", "1.5 KiB", "0 B"]


def test_different_amounts_never_read_alike() -> None:
    assert show_bytes(1026 * 2**20, 2**30) == "1.002 GiB"
    assert show_bytes(2**30, 1026 * 2**20) == "1 GiB"
    assert show_bytes(2**30, 2**30) == "1 GiB"


def test_memory_is_written_as_in_identities() -> None:
    sizes = (1280 * 2**20, 1536 * 2**20, 4 * 2**30, 11776 * 2**20, 2048, 0)
    assert list(map(write_bytes, sizes)) == ["1280 MiB", "1536 MiB", "4 GiB", "11.5 GiB", "2 KiB", "0 B"]


@given(st.integers(0, 2**49))
def test_what_is_written_of_memory_is_exact(size: int) -> None:
    assert parse_quantity(write_bytes(size), Unit.MEMORY) == (Unit.MEMORY, Fraction(size))


@given(st.fractions(min_value=Fraction(1, 10**9), max_value=100))
def test_amount_above_zero_is_not_shown_as_zero(amount: Fraction) -> None:
    shown = [
        show_processors(amount),
        show_processors(-amount),
        show_amount(ProcessorTime(LogicalProcessors(amount))),
        share_of_host(amount, 100, "cell").removesuffix(" of cell"),
    ]

    assert [text for text in shown if not float(text.split()[0])] == []
    assert show_processors(Fraction(1, 250)) == "0.004 LP"


def test_amounts_have_two_decimals() -> None:
    assert show_processors(Fraction(11, 3)) == "3.67 LP"
    assert show_reserve(80, 2) == "1.6 LP (80 % of its 2 VPs)"
    assert share_of_host(Fraction(8, 5), 8, "cell") == "20 % of cell"
    assert show_amount(ShareOfHost(Percent(Fraction(70)))) == "70 % of host"
