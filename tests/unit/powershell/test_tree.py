import pytest

from rarms_iac.powershell.literals import literal
from rarms_iac.powershell.tree import LITERAL, NotParsed, parse_strictly
from tests.effort import LONG
from tests.unit.powershell.hostile import PIECES, QUOTES, hostile_texts
from tests.unit.powershell.plans import same_structure, shape

BATCH = 100


def a_script(written: list[str]) -> str:
    """Each value where a template may put one: assigned, as an argument, in a table, in a call."""
    places = ("$a = {0}", "Use-It -Name {0} -Count 2", "$t = @{{ A = {0}; {0} = 1 }}", "[Text]::From({0})")
    return "".join(places[at % 4].format(literal) + "\r\n" for at, literal in enumerate(written))


def naive(text: str) -> str:
    """How one would quote who knows of one quote character only."""
    return "'" + text.replace("'", "''") + "'"


HARMLESS = a_script(["'x'"] * BATCH)


def test_no_value_changes_the_structure() -> None:
    texts = hostile_texts(100_000 if LONG else 4_000, seed=11)
    for at in range(0, len(texts), BATCH):
        assert same_structure(HARMLESS, a_script([literal(text) for text in texts[at : at + BATCH]]))


def test_naive_quoting_is_caught() -> None:
    broken = [text for text in hostile_texts(400, seed=3) if any(text.count(quote) for quote in QUOTES[1:])]
    missed = [text for text in broken if same_structure(a_script(["'x'"]), a_script([naive(text)]))]

    assert len(broken) > 100
    assert [text for text in missed if not _reads_the_same(text)] == []


def _reads_the_same(text: str) -> bool:
    """Whether the naive literal happens to be one string all the same: only its value is another then."""
    from rarms_iac.powershell.tokens import NotTokens, tokens

    try:
        return len(tokens(naive(text))) == 1
    except NotTokens:
        return False


@pytest.mark.parametrize("piece", PIECES)
def test_each_piece_is_a_leaf_as_number_text_or_truth(piece: str) -> None:
    for value in (piece, piece * 3, f"a{piece}", True, 7):
        assert same_structure(a_script(["1"] * 4), a_script([literal(value)] * 4))


def test_arrays_of_literals_are_one_leaf() -> None:
    for values in ([], ["a"], ["a", "it's\u2019", "3"]):
        assert same_structure("$a = @('x')\r\n", f"$a = @({', '.join(map(literal, values))})\r\n")
    assert not same_structure("$a = @('x')\r\n", "$a = @('x'; Get-It)\r\n")
    assert not same_structure("$a = @('x')\r\n", "$a = @($x)\r\n")


@pytest.mark.parametrize(
    "script",
    ["$a = 'x' + 'y'", "$a = ('x')", "$a = $x", "$a = ('' + $x)", "$a = 'x'; $b = 'x'", '$a = "x"', "$a = 'x'.Length"],
)
def test_other_expressions_are_no_literals(script: str) -> None:
    assert not same_structure("$a = 'x'\r\n", script + "\r\n")


@pytest.mark.parametrize("script", ["$a = '", "if (", "$a = 'b\u2019c'", "# a\r\n'"])
def test_a_script_that_is_not_understood_has_no_shape(script: str) -> None:
    with pytest.raises(NotParsed):
        shape(script)


def test_a_shape_forgets_values_and_remarks_only() -> None:
    assert shape("$a = 'x' # why") == shape("$a = 9 # because")
    assert LITERAL in {leaf.label for leaf in shape("$a = 'x'")}
    assert shape("$a = 'x'") != shape("$b = 'x'")
    assert shape("Get-A -B 1") != shape("Get-A -C 1")


@pytest.mark.parametrize(
    "script", ["| Get-Item -Path 'x'\n", "Get-Item -Path 'x'\n| Get-Item\n", "try {\n    | x\n}\n"]
)
def test_a_line_that_begins_with_a_pipe_is_an_error(script: str) -> None:
    with pytest.raises(NotParsed):
        parse_strictly(script)


def test_a_backtick_outside_of_texts_and_remarks_is_an_error() -> None:
    parse_strictly("Get-Item -Path 'a`b'  # c`d\n")
    with pytest.raises(NotParsed, match="line 2: a backtick"):
        parse_strictly("Get-Item -Path 'a`b'\nGet-Item `\n -Path 'x'\n")
