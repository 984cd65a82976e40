"""Findings for programs: one versioned document."""

import json
from collections.abc import Sequence
from typing import Any

from rarms_iac.model.diagnostics import Diagnostic, Place, Severity

FORMAT_VERSION = "rarms-output/1"


def as_json(diagnostics: Sequence[Diagnostic], *, accepted: Sequence[Diagnostic] = (), certificate: str = "") -> str:
    """The document as text: ASCII, so that no encoding on the way can harm it; ends with a line end.

    `certificate`: JSON text that shows that no layout exists; empty where there is none.
    """
    document = {**findings_document(diagnostics, accepted=accepted), "certificate": certificate}
    return json.dumps(document, indent=2) + "\n"


def findings_document(diagnostics: Sequence[Diagnostic], *, accepted: Sequence[Diagnostic] = ()) -> dict[str, Any]:
    """The document as plain values; other commands put it into theirs."""
    return {
        "format_version": FORMAT_VERSION,
        "kind": "findings",
        "findings": [_finding(diagnostic) for diagnostic in diagnostics],
        "accepted": [_finding(diagnostic) for diagnostic in accepted],
        "counts": {
            f"{severity.value}s": sum(diagnostic.severity is severity for diagnostic in diagnostics)
            for severity in Severity
        },
    }


def _finding(diagnostic: Diagnostic) -> dict[str, Any]:
    return {
        "code": diagnostic.code,
        "severity": diagnostic.severity.value,
        "summary": _encodable(diagnostic.summary),
        "detail": _encodable(diagnostic.detail),
        "advice": _encodable(diagnostic.advice),
        "address": _encodable(diagnostic.address),
        "place": None if diagnostic.place is None else _place(diagnostic.place),
        "related": [{"place": _place(other.place), "says": _encodable(other.says)} for other in diagnostic.related],
    }


def _place(place: Place) -> dict[str, str | int]:
    return {
        "file": _encodable(place.file),
        "line": place.line,
        "column": place.column,
        "length": place.length,
        "path": _encodable(place.path),
    }


def _encodable(text: str) -> str:
    """The text with lone surrogates replaced: strict parsers refuse their escapes."""
    return text.encode("utf-8", "replace").decode("utf-8")
