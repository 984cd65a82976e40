import json
from pathlib import Path

import pytest
from hypothesis import given
from hypothesis import strategies as st

from rarms_iac.model.wording import remark
from rarms_iac.powershell.literals import LARGEST, MOST_PARTS, NoLiteral, NotALiteral, literal, read_literal
from rarms_iac.powershell.tokens import NotTokens, TokenKind, tokens
from tests.effort import LONG
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
def test_what_has_no_literal_is_refused_with_its_facts(value: int | str) -> None:
    with pytest.raises(NoLiteral) as refused:
        literal(value)

    assert refused.value.value == value
    assert refused.value.why


@given(st.one_of(st.booleans(), st.integers(0, LARGEST), st.text(max_size=60)))
def test_any_value_is_read_back(value: bool | int | str) -> None:
    written = literal(value)

    assert written.isascii()
    assert written.isprintable()
    assert read_literal(written) == value
    assert type(read_literal(written)) is type(value)


def test_hostile_texts_are_read_back() -> None:
    for text in hostile_texts(100_000 if LONG else 5_000):
        assert read_literal(literal(text)) == text


def test_the_proven_literals_are_read_back() -> None:
    cases = json.loads(RECORDED.read_text(encoding="utf-8"))["cases"]

    assert len(cases) == 299
    for case in cases:
        (token,) = tokens(case["literal"])
        assert (token.kind, token.text) == (TokenKind.STRING, case["text"])


@pytest.mark.parametrize(
    "text",
    ["", "a", "$null", "'a' 'b'", "'a'; 1", "('a')x", "()", "(1 + 2)", "('' 'a')", "('' + $x)", "('' + [int]0x0041)"],
)
def test_nothing_else_is_a_literal(text: str) -> None:
    with pytest.raises(NotALiteral):
        read_literal(text)


@pytest.mark.parametrize("text", ["'a", "'a''", '"a', "\"$('", "<# a", "@'\r\na\r\n '@", "${a"])
def test_what_does_not_end_is_no_token(text: str) -> None:
    with pytest.raises(NotTokens):
        tokens(text)


def test_tokens_of_a_script() -> None:
    script = "$a = @{ B = 'it''s' } # it's\r\n\"x$('y')\" <# ' #> @'\r\nz'\r\n'@ `\r\n O\u2019k\u2019"

    assert [(token.kind.value, token.text) for token in tokens(script) if token.kind not in ("word", "structure")] == [
        ("string", "it's"),
        ("comment", "# it's"),
        ("newline", "\r\n"),
        ("expandable string", "\"x$('y')\""),
        ("comment", "<# ' #>"),
        ("string", "z'"),
        ("string", "k"),
    ]


def test_a_remark_stays_on_its_line() -> None:
    for text in hostile_texts(2_000):
        assert remark(text).isascii()
        assert [token.kind for token in tokens(f"# why: {remark(text)}")] == [TokenKind.COMMENT]
