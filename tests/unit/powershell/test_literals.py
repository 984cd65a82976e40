import json
from pathlib import Path

import pytest
from hypothesis import given
from hypothesis import strategies as st

from rarms_iac.model.wording import remark
from rarms_iac.powershell.literals import LARGEST, MOST_PARTS, NoLiteral, literal
from tests.effort import LONG
from tests.fake_powershell.compiling import compiled
from tests.fake_powershell.host import WindowsHost
from tests.fake_powershell.scopes import Scope, Session
from tests.fake_powershell.values import Value
from tests.unit.powershell.hostile import hostile_texts

RECORDED = Path(__file__).resolve().parents[2] / "recorded/powershell/literals.json"


@pytest.mark.parametrize(
    ("value", "written"),
    [
        ("", "''"),
        ("O'Brien", "'O''Brien'"),
        ("$(x) `n", "'$(x) `n'"),
        ("right\u2019", "('' + 'right' + [char]0x2019)"),
        ("\U0001f600", "('' + [char]0xD83D + [char]0xDE00)"),
        ("a\r\nb", "('' + 'a' + [char]0x000D + [char]0x000A + 'b')"),
        (True, "$true"),
        (False, "$false"),
        (0, "0"),
        (536870912, "536870912"),
    ],
)
def test_each_form(value: bool | int | str, written: str) -> None:
    assert literal(value) == written


@pytest.mark.parametrize("value", [-1, LARGEST + 1, "\ud800", "x\udfff", "é" * (MOST_PARTS + 1)])
def test_unrepresentable_value_is_refused(value: int | str) -> None:
    with pytest.raises(NoLiteral) as refused:
        literal(value)

    assert refused.value.value == value
    assert refused.value.why


def evaluated(written: list[str]) -> list[Value]:
    """What these literals give as statements of a script."""
    values: list[Value] = []
    session = Session(WindowsHost(), windows_powershell=True, path="C:\\x.ps1", declined=frozenset())
    compiled("".join(f"{text}\r\n" for text in written).encode("ascii")).body(Scope(session, None), values)
    return [_joined(value) if isinstance(value, str) else value for value in values]


def _joined(text: str) -> str:
    """Two halves of a surrogate pair as one character, which they are to PowerShell."""
    return text.encode("utf-16-le", "surrogatepass").decode("utf-16-le")


@given(st.lists(st.one_of(st.booleans(), st.integers(0, LARGEST), st.text(max_size=60)), min_size=1))
def test_any_value_is_what_its_literal_gives(values: list[bool | int | str]) -> None:
    written = [literal(value) for value in values]

    assert all(text.isascii() and text.isprintable() for text in written)
    assert evaluated(written) == values


def test_hostile_texts_are_what_their_literals_give() -> None:
    texts = hostile_texts(100_000 if LONG else 5_000)

    assert evaluated([literal(text) for text in texts]) == texts


def test_plain_texts_are_quoted_as_powershell_proved() -> None:
    cases = json.loads(RECORDED.read_text(encoding="utf-8"))["cases"]
    plain = [case for case in cases if case["text"].isascii() and case["text"].isprintable()]

    assert len(plain) == 60
    assert [literal(case["text"]) for case in plain] == [case["literal"] for case in plain]


def test_a_remark_stays_on_its_line() -> None:
    for text in hostile_texts(2_000):
        assert remark(text).isascii()
        assert remark(text).isprintable()
