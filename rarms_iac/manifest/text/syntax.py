"""Text that is no YAML: where the parser stopped, and why, in a user's words."""

from yaml.error import YAMLError

from rarms_iac.manifest.text.characters import place_at, place_of
from rarms_iac.model.diagnostics import Diagnostic
from rarms_iac.model.shared_findings import NOT_YAML


def syntax_finding(problem: YAMLError, data: bytes, file: str) -> Diagnostic:
    """Return the finding for what the parser cannot read: at the place that it names, or at the end of the text."""
    mark = getattr(problem, "problem_mark", None) or getattr(problem, "context_mark", None)
    complaint = str(getattr(problem, "problem", ""))
    if mark is not None and data.decode("utf-8")[mark.index : mark.index + 1] == "\t":
        complaint = "found a tab character"
    detail, advice = _explain(complaint, str(getattr(problem, "context", "") or ""))
    # The parser puts what is missing at the end onto a line of its own, which may not exist.
    end = place_of(data, len(data.rstrip()), file)
    place = end if mark is None or mark.line + 1 > end.line else place_at(mark, file)
    return NOT_YAML.at(place, "{_detail}", advice, _detail=detail, parser=complaint)


_COMPLAINTS: tuple[tuple[str, str, str], ...] = (
    (
        "mapping values are not allowed",
        "A colon is in a place where no key can be.",
        "Put a text that holds ': ' into quotes, or check the indentation of this line.",
    ),
    (
        "could not find expected ':'",
        "A key has no colon.",
        "Write `key: value`, with a space after the colon. Check the line before, too.",
    ),
    (
        "found character that cannot start any token",
        "This character cannot start a value.",
        "Put the value into quotes; indent with spaces, not with tabs.",
    ),
    ("found a tab character", "A tab is in a place where indentation is expected.", "Indent with spaces."),
    (
        "did not find expected ',' or ']'",
        "A list that starts with [ is not closed, or lacks a comma.",
        "Add the missing comma or ].",
    ),
    (
        "did not find expected ',' or '}'",
        "A map that starts with { is not closed, or lacks a comma.",
        "Add the missing comma or }.",
    ),
    (
        "did not find expected key",
        "A key is expected here.",
        "Check the indentation of this line and of those before it, and that quotes are closed.",
    ),
    (
        "did not find expected '-' indicator",
        "The next item of the list is expected here.",
        "Start it with '- ', or check the indentation.",
    ),
    (
        "block sequence entries are not allowed",
        "A list item is not allowed here.",
        "Start the list on a line of its own.",
    ),
    ("found unexpected end of stream", "The text ends inside quotes.", "Close the quotes."),
    ("found unexpected document indicator", "The document ends inside quotes.", "Close the quotes."),
    (
        "found unknown escape character",
        "This backslash sequence has no meaning in double quotes.",
        "Write a backslash twice, or use single quotes.",
    ),
    (
        "invalid Unicode character escape code",
        "This backslash sequence is not a character.",
        "Write the character itself.",
    ),
    (
        "did not find expected hexdecimal number",
        "This backslash sequence needs hexadecimal digits.",
        "Write \\xHH, \\uHHHH or \\UHHHHHHHH.",
    ),
    (
        "did not find expected node content",
        "A value is expected here.",
        "Write a value, or remove the comma before it.",
    ),
    (
        "did not find expected <document start>",
        "There is more text after the end of the document.",
        "Check the indentation of this line.",
    ),
    ("undefined tag handle", "rarms does not read tags (!name).", "Remove the tag: a field knows its own type."),
    (
        "did not find expected alphabetic or numeric character",
        "rarms does not read anchors (&name) and aliases (*name).",
        "Put a text that starts with & or * into quotes.",
    ),
    ("incompatible YAML document", "rarms reads YAML 1.2.", "Remove the line that starts with %YAML."),
    (
        "chomping or indentation indicator",
        "There is text after | or > that is not allowed there.",
        "Start the text on the next line, or put it into quotes.",
    ),
)
"""What the parser says, and the same as (detail, advice) for a user."""


def _explain(problem: str, context: str) -> tuple[str, str]:
    """Return what the parser found wrong and what to do, as (detail, advice)."""
    for complaint in (problem, context):
        for words, detail, advice in _COMPLAINTS:
            if words in complaint:
                return detail, advice
    complaint = " ".join(part for part in (context, problem) if part)
    return f"The text cannot be read as YAML here ({complaint}).", "Check this line and the one before it."
