"""One value of a manifest is changed, and nothing else."""

from textwrap import dedent

import pytest

from rarms_iac.manifest.edit.values import NoSuchPlace, Value, remove_value, set_value

ROBOT = dedent("""\
    # The robot.
    schema: rarms/v1
    components:
        vision:   # the eyes
            # more hurts
            criticality: 40
            apt: {mean_response_time: {at_most: 100 ms}}   # to be tuned
            cpu: { reserve: 40 % } # fixed
            # tail of vision
        speech:
            criticality: 30
    """)


def changed_lines(before: str, after: str) -> list[str]:
    """The lines that are gone and those that are new, in their order."""
    old, new = before.splitlines(), after.splitlines()
    return [f"-{line}" for line in old if line not in new] + [f"+{line}" for line in new if line not in old]


def test_a_new_key_comes_at_its_canonical_place() -> None:
    after = set_value(ROBOT, ("components", "vision", "memory"), "512 MiB")

    assert after == ROBOT.replace("        cpu:", "        memory: 512 MiB\n        cpu:")


def test_keys_that_are_missing_on_way_are_added() -> None:
    after = set_value(ROBOT, ("partitions", "vision", "components"), ["vision", "speech"])

    assert after == ROBOT + "\npartitions:\n  vision:\n    components: [vision, speech]\n"


def test_new_key_in_flow_map_stays_in_it() -> None:
    after = set_value(ROBOT, ("components", "vision", "cpu", "limit"), "80 %")

    assert after == ROBOT.replace("{ reserve: 40 % }", "{ reserve: 40 %, limit: 80 % }")


def test_new_entry_comes_last() -> None:
    text = "components:\n  a:\n    criticality: 1\n    # more of a\n# the end\n"

    assert set_value(text, ("components", "b"), {"criticality": 2}) == (
        "components:\n  a:\n    criticality: 1\n    # more of a\n\n  b:\n    criticality: 2\n# the end\n"
    )


def test_comments_inside_a_replaced_value_move_above_it() -> None:
    after = set_value(ROBOT, ("components", "vision"), {"criticality": 1})

    assert after == dedent("""\
        # The robot.
        schema: rarms/v1
        components:
            # the eyes
            # more hurts
            # to be tuned
            # fixed
            # tail of vision
            vision:
              criticality: 1
            speech:
                criticality: 30
        """)


@pytest.mark.parametrize("empty", ["", " {}", " null", " ~  # none yet"])
def test_an_empty_section_is_filled(empty: str) -> None:
    after = set_value(f"schema: rarms/v1\ntasks:{empty}\nmoved: {{}}\n", ("tasks", "MotionControl", "priority"), 5)

    assert "MotionControl:\n    priority: 5" in after
    assert after.count("# none yet") == empty.count("# none yet")


@pytest.mark.parametrize(
    ("value", "written"),
    [(7, "7"), ("7", "'7'"), ("no", "'no'"), (None, "null"), (True, "true"), ("a: b\n", '"a: b\\n"'), (1.5, "1.5")],
)
def test_written_values_are_read_back(value: Value, written: str) -> None:
    assert set_value("application: { name: x }\n", ("application", "description"), value) == (
        f"application: {{ name: x, description: {written} }}\n"
    )


def test_a_canonical_text_stays_canonical() -> None:
    text = "components:\n  a:\n    criticality: 1   # low\n"
    canonical = "components:\n  a:\n    criticality: 1  # low\n"

    assert set_value(text, ("components", "a", "criticality"), 100) == text.replace("1 ", "100 ")
    assert set_value(canonical, ("components", "a", "criticality"), 100) == canonical.replace("1 ", "100 ")


def test_a_text_on_one_line_is_changed_there() -> None:
    assert set_value('{"a": {"b": 1}} # all\n', ("a", "b"), 2) == '{"a": {"b": 2}} # all\n'


def test_line_ends_and_byte_order_mark_stay() -> None:
    assert set_value("\ufeffmoved: {}\r\n", ("moved",), {"a": "b"}) == "\ufeffmoved:\r\n  a: b\r\n"


def test_a_key_is_removed_with_its_comments() -> None:
    after = remove_value(ROBOT, ("components", "vision", "criticality"))

    assert changed_lines(ROBOT, after) == ["-        # more hurts", "-        criticality: 40"]


def test_heir_keeps_comments_of_what_is_removed() -> None:
    text = """\
hosts:
  # big
  a: # the first
    memory: 1 GiB # all of it
    # no more
  # small
  b: {}
"""
    kept = "  # big\n  # the first\n  # all of it\n  # no more\n"

    assert (
        remove_value(text, ("hosts", "a"), comments_to=("hosts", "b", "x")) == f"hosts:\n  # small\n{kept}  b: {{}}\n"
    )
    assert remove_value(text, ("hosts", "a"), comments_to=("tasks",)).endswith("  b: {}\n" + kept.replace("  #", "#"))


def test_last_key_of_map_leaves_empty_map() -> None:
    assert remove_value(ROBOT, ("components", "vision", "cpu", "reserve")) == ROBOT.replace("{ reserve: 40 % }", "{}")


def test_flow_key_is_removed_with_comma() -> None:
    text = "hosts: { a: { memory: 1 GiB }, b: {}, c: {} }\n"

    assert remove_value(text, ("hosts", "a")) == "hosts: { b: {}, c: {} }\n"
    assert remove_value(text, ("hosts", "b")) == "hosts: { a: { memory: 1 GiB }, c: {} }\n"
    assert remove_value(text, ("hosts", "c")) == "hosts: { a: { memory: 1 GiB }, b: {} }\n"


def test_edit_of_missing_path_is_refused() -> None:
    with pytest.raises(
        NoSuchPlace, match=r"^components\.vision\.criticality\.deep: components\.vision\.criticality has"
    ):
        set_value(ROBOT, ("components", "vision", "criticality", "deep"), 1)
    with pytest.raises(NoSuchPlace, match="this path does not exist"):
        remove_value(ROBOT, ("components", "hearing"))
