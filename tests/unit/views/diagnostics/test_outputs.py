import pytest

from rarms_iac.views.diagnostics import BadOutput, Output, OutputFormat, parse_outputs


def test_without_a_wish_text_goes_to_standard_output() -> None:
    assert parse_outputs([]) == (Output(format=OutputFormat.TEXT, path=None),)


def test_several_outputs_come_from_one_run() -> None:
    assert parse_outputs(["sarif=findings.sarif", "text", "junit=a=b.xml"]) == (
        Output(format=OutputFormat.SARIF, path="findings.sarif"),
        Output(format=OutputFormat.TEXT, path=None),
        Output(format=OutputFormat.JUNIT, path="a=b.xml"),
    )


def test_a_dash_is_standard_output() -> None:
    assert parse_outputs(["json=-"]) == (Output(format=OutputFormat.JSON, path=None),)


@pytest.mark.parametrize(
    ("values", "message"),
    [
        (["sraif"], 'Did you mean "sarif"'),
        (["SARIF=x"], "text, json, sarif, junit, github"),
        ([""], "is no form of output"),
        (["sarif="], "names no file"),
        (["text", "json"], "two outputs go to standard output"),
        (["json=x", "sarif=x"], "two outputs go to x"),
    ],
)
def test_what_cannot_be_done_is_refused_with_what_can(values: list[str], message: str) -> None:
    with pytest.raises(BadOutput, match=message):
        parse_outputs(values)
