from rarms_iac.views.diagnostics.layout import columns
from rarms_iac.views.explain import explain_finding, for_a_terminal, unknown_code


def test_a_finding_is_explained_by_its_page_whatever_the_case_of_its_id() -> None:
    text = explain_finding("rarms042")

    assert text is not None
    assert text.startswith("RARMS042: A name that nothing has\n=================================\n\nSeverity: error.\n")
    assert "    apart: [video-straeming]" in text
    assert "```" not in text


def test_an_unknown_id_has_no_page_and_the_answer_says_where_all_are() -> None:
    assert explain_finding("RARMS000") is None
    assert explain_finding("../RARMS042") is None
    assert "Did you mean" not in unknown_code("RARMS999"), "a number that is near says nothing"
    assert "docs/diagnostics.md lists them all" in unknown_code("RARMS999")


def test_a_page_becomes_text_of_eighty_columns_with_its_code_as_written() -> None:
    text = for_a_terminal(
        "# T\n\n" + "word " * 40 + "\nmore [a link](x.md)\n\n- one\n- two\n  lines\n\n```\n# code\n```\nend\n"
    )

    assert all(columns(line) <= 80 for line in text.splitlines())
    assert "more a link\n" in text
    assert "\n- one\n- two lines\n" in text
    assert "\n    # code\n" in text
    assert text.endswith("\nend\n")
