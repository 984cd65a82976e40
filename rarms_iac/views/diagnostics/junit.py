"""Findings as a JUnit report: a test case each, failed where it is an error."""

from collections.abc import Sequence
from xml.etree import ElementTree as ET

from rarms_iac.model.diagnostics import Diagnostic, Severity
from rarms_iac.views.diagnostics.layout import visible


def as_junit(diagnostics: Sequence[Diagnostic], *, accepted: Sequence[Diagnostic] = ()) -> str:
    """One suite; warnings and notes pass and speak in `system-out`, what the policy accepts is skipped.

    Without any finding it has one case that passes: an empty report looks like a run that never was.
    """
    errors = sum(diagnostic.severity is Severity.ERROR for diagnostic in diagnostics)
    total = len(diagnostics) + len(accepted)
    counts = {"tests": str(total or 1), "failures": str(errors), "errors": "0", "skipped": str(len(accepted))}
    root = ET.Element("testsuites", {"name": "rarms", **counts})
    suite = ET.SubElement(root, "testsuite", {"name": "findings", **counts})
    for diagnostic in diagnostics:
        _told(_case(suite, diagnostic), diagnostic)
    for one in accepted:
        ET.SubElement(_case(suite, one), "skipped", message="accepted by policy.accept")
    if not total:
        ET.SubElement(suite, "testcase", classname="rarms", name="No findings")
    ET.indent(root)
    return '<?xml version="1.0" encoding="UTF-8"?>\n' + ET.tostring(root, encoding="unicode") + "\n"


def _case(suite: ET.Element, diagnostic: Diagnostic) -> ET.Element:
    where = (
        {} if diagnostic.place is None else {"file": _xml(diagnostic.place.file), "line": str(diagnostic.place.line)}
    )
    spot = diagnostic.address if diagnostic.place is None else str(diagnostic.place)
    name = _xml(
        f"{diagnostic.code} {diagnostic.summary} ({spot})" if spot else f"{diagnostic.code} {diagnostic.summary}"
    )
    classname = _xml(diagnostic.place.file if diagnostic.place else "rarms")
    return ET.SubElement(suite, "testcase", {"classname": classname, "name": name, **where})


def _told(case: ET.Element, diagnostic: Diagnostic) -> None:
    where = f"{diagnostic.place}, {diagnostic.place.path}\n" if diagnostic.place else ""
    text = _xml(f"{where}{diagnostic.detail}\n{diagnostic.advice}")
    if diagnostic.severity is Severity.ERROR:
        ET.SubElement(case, "failure", type=diagnostic.code, message=_xml(diagnostic.summary)).text = text
    else:
        ET.SubElement(case, "system-out").text = f"{diagnostic.severity.value}: {text}"


def _xml(text: str) -> str:
    """The text with what XML 1.0 has no way to write spelt out."""
    return "".join("<U+FFFE>" if one == "\ufffe" else "<U+FFFF>" if one == "\uffff" else one for one in visible(text))
