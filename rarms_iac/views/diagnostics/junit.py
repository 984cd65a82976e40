"""Findings as a JUnit report: a test case each, failed where it is an error."""

from collections.abc import Sequence
from xml.etree import ElementTree as ET

from rarms_iac.model.diagnostics import Diagnostic, Severity
from rarms_iac.views.diagnostics.layout import visible


def as_junit(diagnostics: Sequence[Diagnostic], *, accepted: Sequence[Diagnostic] = ()) -> str:
    """One suite; warnings and notes pass and speak in `system-out`, what the policy accepts is skipped.

    Without any finding it has one case that passes: an empty report looks like a run that never was.
    """
    errors = sum(one.severity is Severity.ERROR for one in diagnostics)
    total = len(diagnostics) + len(accepted)
    counts = {"tests": str(total or 1), "failures": str(errors), "errors": "0", "skipped": str(len(accepted))}
    root = ET.Element("testsuites", {"name": "rarms", **counts})
    suite = ET.SubElement(root, "testsuite", {"name": "findings", **counts})
    for one in diagnostics:
        _told(_case(suite, one), one)
    for one in accepted:
        ET.SubElement(_case(suite, one), "skipped", message="accepted by policy.accept")
    if not total:
        ET.SubElement(suite, "testcase", classname="rarms", name="No findings")
    ET.indent(root)
    return '<?xml version="1.0" encoding="UTF-8"?>\n' + ET.tostring(root, encoding="unicode") + "\n"


def _case(suite: ET.Element, one: Diagnostic) -> ET.Element:
    where = {} if one.place is None else {"file": _xml(one.place.file), "line": str(one.place.line)}
    spot = one.address if one.place is None else str(one.place)
    name = _xml(f"{one.code} {one.summary} ({spot})" if spot else f"{one.code} {one.summary}")
    classname = _xml(one.place.file if one.place else "rarms")
    return ET.SubElement(suite, "testcase", {"classname": classname, "name": name, **where})


def _told(case: ET.Element, one: Diagnostic) -> None:
    where = f"{one.place}, {one.place.path}\n" if one.place else ""
    text = _xml(f"{where}{one.detail}\n{one.advice}")
    if one.severity is Severity.ERROR:
        ET.SubElement(case, "failure", type=one.code, message=_xml(one.summary)).text = text
    else:
        ET.SubElement(case, "system-out").text = f"{one.severity.value}: {text}"


def _xml(text: str) -> str:
    """The text with what XML 1.0 has no way to write spelt out."""
    return "".join("<U+FFFE>" if one == "\ufffe" else "<U+FFFF>" if one == "\uffff" else one for one in visible(text))
