from rarms_iac.storage.finding_pages import finding_page
from rarms_iac.views.console import columns, render
from rarms_iac.views.finding_page import page_text, unknown_code


def test_a_finding_is_explained_by_its_page() -> None:
    page = finding_page("RARMS042")

    assert page is not None
    text = render(page_text(page))
    assert text.startswith("RARMS042: Unknown name\n======================\n\nSeverity: error.\n")
    assert "    apart: [video-straeming]" in text
    assert "```" not in text


def test_unknown_id_says_where_all_are() -> None:
    assert finding_page("RARMS000") is None
    assert finding_page("../RARMS042") is None
    assert "Did you mean" not in unknown_code("RARMS999"), "a number that is near says nothing"
    assert "docs/diagnostics.md lists them all" in unknown_code("RARMS999")


def test_page_becomes_eighty_columns() -> None:
    page = "# T\n\n" + "word " * 40 + "\nmore [a link](x.md)\n\n- one\n- two\n  lines\n\n```\n# code\n```\nend\n"

    text = render(page_text(page))

    assert all(columns(line) <= 80 for line in text.splitlines())
    assert "more a link\n" in text
    assert "\n- one\n- two lines\n" in text
    assert "\n    # code\n" in text
    assert text.endswith("\nend\n")


def test_example_lines_hang_below_first_word() -> None:
    first, second = "face-detection 70 %, speech-recognition 30 % and path-planning 20 % need", "120 % of the two."

    text = render(page_text(f"# T\n\n```\nerror\n  {first} {second}\n```\n"))

    assert f"      {first}\n      {second}\n" in text
