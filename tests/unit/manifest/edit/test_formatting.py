"""The canonical form, case by case."""

from textwrap import dedent

import pytest

from rarms_iac.manifest.edit.formatting import CannotFormat, diff_text, format_text


def formatted(text: str) -> str:
    return format_text(dedent(text).lstrip("\n"), "rarms.yaml")


def test_known_keys_are_ordered_and_maps_kept() -> None:
    text = """
        components:
          zebra: {memory: 1 GiB, criticality: 1}
          ant: {criticality: 2}
        schema: rarms/v1
        """

    assert formatted(text) == (
        "schema: rarms/v1\n\ncomponents:\n  zebra: { criticality: 1, memory: 1 GiB }\n  ant: { criticality: 2 }\n"
    )


def test_comments_stay_with_what_they_are_about() -> None:
    text = """
        # The robot.

        components:   # what runs
            # the first
            vision:
                memory: 1 GiB # enough
                # weight: 100
                criticality: 40

            # - speech comes later
        # nothing follows
        """

    assert formatted(text) == dedent("""\
        # The robot.

        components:  # what runs
          # the first
          vision:
            # weight: 100
            criticality: 40
            memory: 1 GiB  # enough

          # - speech comes later
        # nothing follows
        """)


def test_file_comment_stays_on_top() -> None:
    assert formatted("# About this file.\n\n# hosts\nhosts: {}\nschema: rarms/v1\n") == (
        "# About this file.\n\nschema: rarms/v1\n\n# hosts\nhosts: {}\n"
    )


def test_comments_inside_a_flow_map_open_it() -> None:
    text = """
        components:
          a: { memory: 1 GiB,   # enough
               cpu: { reserve: 10 % } }  # all of it
        """

    assert formatted(text) == dedent("""\
        components:
          a:               # all of it
            memory: 1 GiB  # enough
            cpu: { reserve: 10 % }
        """)


def test_quantities_get_one_space() -> None:
    text = "application: {name: robot, description: 88ms}\nhosts: {a: {memory: '4GiB'}}\n"

    assert formatted(text) == "application: { name: robot, description: 88ms }\nhosts: { a: { memory: 4 GiB } }\n"


@pytest.mark.parametrize(
    ("written", "canonical"),
    [
        ('"plain text"', "plain text"),
        ('"no"', "'no'"),
        ("no", "no"),
        ("'7'", "'7'"),
        ('"it\'s"', '"it\'s"'),
        (r'"tab\t"', r'"tab\t"'),
        ("'^a(b)$'", "'^a(b)$'"),
        ("'components.planning:plan'", "components.planning:plan"),
        ("''", "''"),
        ("~", "~"),
    ],
)
def test_quotes_stand_only_where_they_are_needed(written: str, canonical: str) -> None:
    assert formatted(f"application: \n  name: {written}\n") == f"application:\n  name: {canonical}\n"


def test_block_scalars_keep_their_lines() -> None:
    text = "application:\n    description: |\n        one\n          two\n    name: >-\n        three\n        four\n"

    assert formatted(text) == ("application:\n  name: >-\n    three\n    four\n  description: |\n    one\n      two\n")


def test_a_long_text_over_several_lines_is_folded() -> None:
    words = "many words " * 6
    result = formatted(f"application:\n  description: {words}\n    {words}\n")

    assert result.startswith("application:\n  description: >-\n    many words")
    assert max(len(line) for line in result.splitlines()) <= 100


def test_long_flow_collection_is_written_as_block() -> None:
    words = ", ".join(f"--option-{number}" for number in range(12))

    assert formatted(f"components: {{ a: {{ run: {{ command: [{words}] }} }} }}\n").startswith(
        "components:\n  a:\n    run:\n      command:\n        - --option-0\n"
    )


def test_line_ends_and_byte_order_mark_go() -> None:
    assert formatted("\ufeffschema: rarms/v1\r\nhosts: {}") == "schema: rarms/v1\nhosts: {}\n"


@pytest.mark.parametrize(
    ("text", "place"),
    [
        ("a: [", "rarms.yaml:1:5"),
        ("a: &x 1", "rarms.yaml:1:4"),
        ("a: *x", "rarms.yaml:1:4"),
        ("a: !!str 1", "rarms.yaml:1:4"),
        ("a: 1\n---\nb: 2\n", "rarms.yaml:2:1"),
        ("a: 1\na: 2\n", "rarms.yaml:2:1"),
        ("- a", "rarms.yaml:1:1"),
        ("text", "rarms.yaml:1:1"),
        ("# only this\n", "rarms.yaml:1:1"),
        ("", "rarms.yaml:1:1"),
        ("a: \ud800", "rarms.yaml:1:4"),
        ("? [a]\n: b", "rarms.yaml:1:3"),
        ("a: 1\n? " + "k" * 2_000 + "\n: b\n", "rarms.yaml:2:3"),
        ("a: " + "[" * 60_000, "rarms.yaml:1:"),
    ],
)
def test_non_manifest_is_refused_with_place(text: str, place: str) -> None:
    with pytest.raises(CannotFormat) as refusal:
        formatted(text)

    assert [str(diagnostic.place).startswith(place) for diagnostic in refusal.value.diagnostics] == [True]


def test_difference_names_the_file() -> None:
    before = "schema:   rarms/v1"

    assert diff_text(before, formatted(before), "rarms.yaml") == (
        "--- rarms.yaml\n+++ rarms.yaml (formatted)\n@@ -1 +1 @@\n-schema:   rarms/v1\n"
        "\\ No newline at end of file\n+schema: rarms/v1\n"
    )
    assert diff_text("a: 1\n", "a: 1\n", "rarms.yaml") == ""
