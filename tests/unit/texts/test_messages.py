"""Words in a row, names that were misspelt, and text of other programs."""

import json
import re
from dataclasses import dataclass
from fractions import Fraction
from pathlib import Path

import pytest

import rarms_iac
from rarms_iac.model.changes import Address
from rarms_iac.model.commands import APPLY, Prose, command, prose, sentences
from rarms_iac.model.output import Internal, OpenBound, output
from rarms_iac.storage.codec import encode_output
from rarms_iac.texts.findings import Finding
from rarms_iac.texts.messages import (
    MOST_SUGGESTIONS,
    Suggestions,
    did_you_mean,
    distance,
    in_a_row,
    last_words,
    list_others,
    natural_order,
    number,
    quoted,
    reason_of,
    suggestion,
)
from scripts.schema_of_types import output_schema_of


@pytest.mark.parametrize(
    ("words", "row"), [(["a"], "a"), (["a", "b"], "a and b"), (["a", "b", "c"], "a, b and c"), ([43, 45], "43 and 45")]
)
def test_words_stand_in_a_row(words: list[object], row: str) -> None:
    assert in_a_row(words) == row
    assert in_a_row(words, "or") == row.replace("and", "or")


def test_small_numbers_are_words() -> None:
    assert [number(many) for many in (0, 2, 12, 13)] == ["no", "two", "twelve", "13"]


@pytest.mark.parametrize(
    ("word", "meant"),
    [
        ("visoin", "vision"),
        ("Vision", "vision"),
        ("vsion", "vision"),
        ("visions", "vision"),
        ("speach", "speech"),
        ("navigation", None),
        ("x", None),
        ("", None),
    ],
)
def test_slip_finds_name_and_another_word_does_not(word: str, meant: str | None) -> None:
    assert did_you_mean(word, ["speech", "vision"]) == meant


def test_ties_go_by_name() -> None:
    assert did_you_mean("arm-3", ["arm-2", "arm-1"]) == did_you_mean("arm-3", ["arm-1", "arm-2"]) == "arm-1"


def test_the_word_itself_is_no_suggestion() -> None:
    assert did_you_mean("vision", ["vision"]) is None


def test_a_suggestion_is_a_sentence_or_nothing() -> None:
    assert suggestion("visoin", ["vision"]) == ' Did you mean "vision"?'
    assert suggestion("navigation", ["vision"]) == ""


@pytest.mark.parametrize(
    ("text", "other", "expected"),
    [("ab", "ba", 1), ("abc", "", 3), ("", "", 0), ("kitten", "sitting", 3), ("aaaa", "bbbb", 4)],
)
def test_distance_counts_slips(text: str, other: str, expected: int) -> None:
    assert distance(text, other, 9) == expected


def test_distance_stops_above_its_limit() -> None:
    assert distance("aaaaaaaa", "bbbbbbbb", 2) == 3


def test_quoted_text_is_one_visible_line() -> None:
    assert quoted("vision") == '"vision"'
    assert quoted("vid\x00eo\n\u202eexe\xa0") == '"vid<U+0000>eo<U+000A><U+202E>exe<U+00A0>"'
    assert quoted("it's") == '"it\'s"'
    assert quoted("abcdef", 3) == '"abc..."'


@pytest.mark.parametrize(
    ("names", "without", "expected"),
    [
        ("a", "", "a"),
        ("abc", "b", "a and c"),
        ("abcdef", "a", "b, c, d, e and f"),
        ("abcdefgh", "b", "a, c, d, e and 3 more"),
    ],
)
def test_of_many_names_the_first_are_listed(names: str, without: str, expected: str) -> None:
    assert list_others(names, without) == expected


def test_names_are_in_order_in_which_reader_counts() -> None:
    assert sorted(["c10", "c2", "a", "c1", "c1b2", "c1b10", "2"], key=natural_order) == [
        "2",
        "a",
        "c1",
        "c1b2",
        "c1b10",
        "c2",
        "c10",
    ]


def test_only_first_unknown_names_get_suggestions() -> None:
    suggestions = Suggestions()

    found = [suggestions.find("visoin", ["speech", "vision"]) for _ in range(MOST_SUGGESTIONS + 1)]

    assert set(found[:-1]) == {("vision", ' Did you mean "vision"?')}
    assert found[-1] == ("", " After 20 names, rarms does not search for similar names.")


@pytest.mark.parametrize(
    ("error", "reason"),
    [
        (OSError(28, "No space left on device"), "No space left on device"),
        (OSError("of another kind"), "of another kind"),
        (OSError(5, ""), "[Errno 5]"),
        (OSError(), "OSError"),
        (TimeoutError(), "TimeoutError"),
        (ValueError("in two\n  lines"), "in two lines"),
    ],
)
def test_reason_is_never_empty(error: Exception, reason: str) -> None:
    assert reason_of(error) == reason


@pytest.mark.parametrize(
    ("said", "code", "words"),
    [
        (" no such unit.\n", 5, "no such unit"),
        ("\n", 5, "it ended with exit code 5 and gave no reason"),
        ("", -9, "signal 9 ended it and gave no reason"),
        ("", None, "without a reason"),
    ],
)
def test_last_words_are_never_empty(said: str, code: int | None, words: str) -> None:
    assert last_words(said, code) == words


def test_no_other_module_asks_error_for_its_words() -> None:
    """An OSError may have no `strerror`; programs of their own that import nothing of rarms say what they do then."""
    alone = {
        "install_there.py",
        "instances.py",
        "rcss.py",
        "supervisor_process.py",
        "supervisor_process_windows.py",
        "thread_priorities.py",
        "wording.py",
    }
    package = Path(rarms_iac.__file__).parent

    readers = {file.name for file in package.rglob("*.py") if re.search(r"\.strerror\b(?!\()", file.read_text("utf-8"))}
    assert readers <= alone


LATE = Finding.error("RARMS999", "Too late")


def test_one_set_of_facts_gives_sentence_and_values() -> None:
    found = LATE.at(
        None,
        "{component} stopped after {timeout:ms} with {errors:error}: {loads} and {share:%} of {memory:bytes}{_end}",
        "Wait.",
        component="vision",
        timeout=2000,
        errors=2,
        loads=("a", "b"),
        share=Fraction(1, 2),
        memory=2**29,
        rest_ms=1,
        _end=".",
    )

    assert found.detail == "vision stopped after 2 s with 2 errors: a and b and 0.5 % of 512 MiB."
    assert found.values == {
        "component": "vision",
        "timeout_ms": 2000,
        "errors": 2,
        "loads": ("a", "b"),
        "share_percent": 0.5,
        "memory_bytes": 2**29,
        "rest_ms": 1,
    }


def test_braces_of_a_fact_stay() -> None:
    assert LATE.of_host("{0}", "{host} has {reason}.", "Wait.", reason="{x}").detail == "{0} has {x}."


def test_command_is_data_until_it_is_written_out() -> None:
    measure = command("measure", "vision", again=True, script=False, samples=200, from_="10%")

    assert measure.arguments == ("vision",)
    assert [(option.name, option.value) for option in measure.options] == [
        ("--again", None),
        ("--samples", "200"),
        ("--from", "10%"),
    ]
    assert measure.text == "rarms measure vision --again --samples 200 --from 10%"
    assert command("apply", "my plan.json", f="robot").text == "rarms apply 'my plan.json' -f robot"


def test_text_and_commands_are_joined_piece_by_piece() -> None:
    either = prose(APPLY, " finishes it")

    assert sentences("It stopped.", "", prose("Run it: ", either, ".")) == Prose(
        ("It stopped. Run it: ", APPLY, " finishes it.")
    )
    assert sentences("It stopped.", prose("Wait", ".")) == Prose(("It stopped. Wait.",))
    assert not sentences("", "")


@dataclass(frozen=True, slots=True, kw_only=True)
class Answer:
    """An answer."""

    address: Address
    amount: Fraction
    upper: OpenBound
    secret: Internal[str] = "secret"

    @property
    def unmarked(self) -> int:
        return 1

    @output
    def double(self) -> Fraction:
        return 2 * self.amount


ANSWER = Answer(address=Address(partition="vision"), amount=Fraction(1, 4), upper=float("inf"))


def test_result_is_its_fields_and_its_marked_properties() -> None:
    assert encode_output(ANSWER) == {"address": "partition/vision", "amount": 0.25, "upper": None, "double": 0.5}


def test_the_schema_has_the_same_parts() -> None:
    json_text = json.dumps(encode_output(ANSWER))
    definition = output_schema_of([Answer])["$defs"]["Answer"]

    assert list(definition["properties"]) == definition["required"] == list(json.loads(json_text))
    assert definition["properties"]["upper"] == {"type": ["number", "null"]}
