"""Findings as SARIF 2.1.0, for code-scanning services."""

import json
import os
from collections.abc import Callable, Sequence
from pathlib import PurePath
from typing import Any
from urllib.parse import quote

from rarms_iac import __version__
from rarms_iac.model.diagnostics import Diagnostic, Place, Severity
from rarms_iac.views.diagnostics.layout import visible

SCHEMA = "https://docs.oasis-open.org/sarif/sarif/v2.1.0/errata01/os/schemas/sarif-schema-2.1.0.json"
LEVELS = {Severity.ERROR: "error", Severity.WARNING: "warning", Severity.NOTE: "note"}


def as_sarif(
    diagnostics: Sequence[Diagnostic],
    *,
    page: Callable[[str], str | None],
    accepted: Sequence[Diagnostic] = (),
) -> str:
    """A log with one run; what the policy accepts is in it as suppressed results.

    Args:
        diagnostics: what is shown.
        page: the Markdown page of a code, for the rule's help.
        accepted: what the policy silences.
    """
    rules = {diagnostic.code: diagnostic for diagnostic in (*accepted, *diagnostics)}
    codes = sorted(rules)
    results = [_result(diagnostic, codes.index(diagnostic.code), suppressed=False) for diagnostic in diagnostics]
    results += [_result(diagnostic, codes.index(diagnostic.code), suppressed=True) for diagnostic in accepted]
    log = {
        "$schema": SCHEMA,
        "version": "2.1.0",
        "runs": [
            {
                "tool": {
                    "driver": {
                        "name": "rarms",
                        "semanticVersion": __version__,
                        "rules": [_rule(rules[code], page(code)) for code in codes],
                    }
                },
                "columnKind": "unicodeCodePoints",
                "results": results,
            }
        ],
    }
    return json.dumps(log, indent=2) + "\n"


def _rule(diagnostic: Diagnostic, page: str | None) -> dict[str, Any]:
    """The rule of a finding; its help is the finding's own page."""
    return {
        "id": diagnostic.code,
        "shortDescription": {"text": diagnostic.summary},
        "fullDescription": {"text": diagnostic.summary},
        "help": {"text": page or diagnostic.summary, "markdown": page or diagnostic.summary},
        "defaultConfiguration": {"level": LEVELS[diagnostic.severity]},
    }


def _result(diagnostic: Diagnostic, rule: int, *, suppressed: bool) -> dict[str, Any]:
    result: dict[str, Any] = {
        "ruleId": diagnostic.code,
        "ruleIndex": rule,
        "level": LEVELS[diagnostic.severity],
        "message": {"text": visible(f"{diagnostic.summary}. {diagnostic.detail} {diagnostic.advice}".strip())},
    }
    if diagnostic.place is not None:
        result["locations"] = [_location(diagnostic.place)]
    if diagnostic.related:
        result["relatedLocations"] = [
            {"id": number, **_location(other.place), "message": {"text": visible(other.says)}}
            for number, other in enumerate(diagnostic.related, 1)
        ]
    if diagnostic.address:
        result["properties"] = {"address": visible(diagnostic.address)}
    if suppressed:
        result["suppressions"] = [{"kind": "inSource", "status": "accepted", "justification": "policy.accept"}]
    return result


def _location(place: Place) -> dict[str, Any]:
    location: dict[str, Any] = {
        "physicalLocation": {
            "artifactLocation": {"uri": file_uri(place.file)},
            "region": {
                "startLine": place.line,
                "startColumn": place.column,
                "endColumn": place.column + max(place.length, 1),  # SARIF counts one past the last
            },
        }
    }
    if place.path:
        location["logicalLocations"] = [{"fullyQualifiedName": visible(place.path)}]
    return location


def file_uri(file: str) -> str:
    """A relative reference with `/` and per-cent escapes for a relative path, a file: URI for an absolute one."""
    path = PurePath(file)
    return path.as_uri() if path.is_absolute() else quote(os.fsencode(path.as_posix()), safe="/")
