"""Findings as programs read them: JSON, SARIF, JUnit, GitHub annotations; and which form goes where.

`findings_as` takes findings in order and returns a form of them. `findings` has the form that a person reads, which
alone imports rich.
"""

import json
import os
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from enum import StrEnum
from pathlib import Path, PurePath
from typing import TYPE_CHECKING, Any, assert_never
from urllib.parse import quote
from xml.etree import ElementTree as ET

from rarms_iac.model.commands import sentences
from rarms_iac.model.diagnostics import Diagnostic, Fact, Findings, Place, Places, Severity, Sources
from rarms_iac.model.version import __version__
from rarms_iac.storage.codec import encode_output
from rarms_iac.texts.messages import quoted, suggestion
from rarms_iac.views.console import visible
from rarms_iac.views.json_output import json_of

if TYPE_CHECKING:
    from rich.console import RenderableType


class OutputFormat(StrEnum):
    """The forms that findings can take."""

    TEXT = "text"
    JSON = "json"
    SARIF = "sarif"
    JUNIT = "junit"
    GITHUB = "github"
    MARKDOWN = "markdown"


@dataclass(frozen=True, slots=True, kw_only=True)
class OutputTarget:
    """One form and the file it goes to; None is standard output."""

    format: OutputFormat
    path: str | None = None


class BadOutput(ValueError):
    """The value of `--output` cannot be used; the message says which can."""


def parse_outputs(values: Sequence[str]) -> tuple[OutputTarget, ...]:
    """Return the outputs of a run, in order; text on standard output where none is named.

    Raises:
        BadOutput: an unknown form, an empty file name, or two outputs to one place.
    """
    outputs = tuple(map(_output, values)) or (OutputTarget(format=OutputFormat.TEXT),)
    places = [output.path for output in outputs]
    for place in places:
        if places.count(place) > 1:
            name = "standard output" if place is None else place
            raise BadOutput(
                f"two outputs have the same target {name}: give each its own file, for example sarif=findings.sarif"
            )
    return outputs


def _output(value: str) -> OutputTarget:
    name, equals, path = value.partition("=")
    formats = [form.value for form in OutputFormat]
    if name not in formats:
        raise BadOutput(
            f"{quoted(name)} is not an output format.{suggestion(name, formats)} The formats are {', '.join(formats)}."
        )
    if equals and not path:
        raise BadOutput(f"{quoted(value)} does not have a file: write {name}=FILE, or only {name} for standard output")
    return OutputTarget(format=OutputFormat(name), path=None if path in {"", "-"} else path)


def findings_as(
    form: OutputFormat,
    diagnostics: Sequence[Diagnostic],
    sources: Sources,
    *,
    places: Places,
    accepted: Sequence[Diagnostic] = (),
) -> "RenderableType":
    """Give findings that form, in the order given: text to be laid out, or else the text itself.

    Args:
        sources: The text of each file, or its lines, by the name that places use; only text shows it.
        places: Of the manifest. Each result of SARIF and each annotation has a place; other forms leave it out for a
            finding that has none. NOTE: Code scanning refuses a whole file for one result without a location.
        accepted: Findings that the policy silences; each form marks or counts them.
    """
    match form:
        case OutputFormat.TEXT:
            from rarms_iac.views.findings_text import findings_text

            return findings_text(diagnostics, sources, accepted=accepted)
        case OutputFormat.JSON:
            return json_of(Findings(findings=tuple(diagnostics), accepted=tuple(accepted)))
        case OutputFormat.SARIF:
            from rarms_iac.storage.shipped import finding_page

            shown, silenced = (in_repository(with_places(each, places)) for each in (diagnostics, accepted))
            return as_sarif(shown, page=finding_page, accepted=silenced)
        case OutputFormat.JUNIT:
            return as_junit(in_repository(diagnostics), accepted=in_repository(accepted))
        case OutputFormat.GITHUB:
            return as_github(in_repository(with_places(diagnostics, places)))
        case OutputFormat.MARKDOWN:
            from rarms_iac.views.markdown import findings_markdown

            return findings_markdown(in_repository(diagnostics))
        case _:
            assert_never(form)


def in_repository(diagnostics: Sequence[Diagnostic]) -> tuple[Diagnostic, ...]:
    """Return the findings with their files named from the root of the git repository that rarms was started in.

    Services that show findings next to files know files by these names. Outside of a repository they stay as they are.
    """
    here = Path.cwd()
    root = next((folder for folder in (here, *here.parents) if (folder / ".git").exists()), None)
    if root is None:
        return tuple(diagnostics)

    def moved(place: Place) -> Place:
        file = Path(os.path.normpath(here / place.file))
        inside = file.is_relative_to(root) and not place.file.startswith("<")
        return replace(place, file=file.relative_to(root).as_posix()) if inside else place

    return tuple(
        replace(
            diagnostic,
            place=None if diagnostic.place is None else moved(diagnostic.place),
            related=tuple(replace(other, place=moved(other.place)) for other in diagnostic.related),
        )
        for diagnostic in diagnostics
    )


SCHEMA = "https://docs.oasis-open.org/sarif/sarif/v2.1.0/errata01/os/schemas/sarif-schema-2.1.0.json"
LEVELS = {Severity.ERROR: "error", Severity.WARNING: "warning", Severity.NOTE: "note"}


def as_sarif(
    diagnostics: Sequence[Diagnostic],
    *,
    page: Callable[[str], str | None],
    accepted: Sequence[Diagnostic] = (),
) -> str:
    """Return a log with one run; what the policy accepts is in it as suppressed results.

    Args:
        page: the Markdown page of a code, for the rule's help.
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
    """Return the rule of a finding; its help is the finding's own page."""
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
        "message": {"text": visible(str(sentences(f"{diagnostic.summary}.", diagnostic.detail, diagnostic.advice)))},
    }
    if diagnostic.place is not None:
        result["locations"] = [_location(diagnostic.place)]
    if diagnostic.related:
        result["relatedLocations"] = [
            {"id": number, **_location(other.place), "message": {"text": visible(other.message)}}
            for number, other in enumerate(diagnostic.related, 1)
        ]
    properties = {
        "address": visible(diagnostic.address),
        "values": encode_output(diagnostic.values),
        "commands": encode_output(diagnostic.commands),
    }
    if any(properties.values()):
        result["properties"] = {name: value for name, value in properties.items() if value}
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
    """Return a path as a reference with `/` and per-cent escapes: relative, or a file: URI for an absolute path."""
    path = PurePath(file)
    return path.as_uri() if path.is_absolute() else quote(os.fsencode(path.as_posix()), safe="/")


def as_junit(diagnostics: Sequence[Diagnostic], *, accepted: Sequence[Diagnostic] = ()) -> str:
    """Write one suite; warnings and notes pass, with text in `system-out`; accepted findings are skipped.

    Without any finding it has one case that passes: an empty report looks like a run that never was.
    """
    errors = sum(diagnostic.severity is Severity.ERROR for diagnostic in diagnostics)
    total = len(diagnostics) + len(accepted)
    counts = {"tests": str(total or 1), "failures": str(errors), "errors": "0", "skipped": str(len(accepted))}
    root = ET.Element("testsuites", {"name": "rarms", **counts})
    suite = ET.SubElement(root, "testsuite", {"name": "findings", **counts})
    for diagnostic in diagnostics:
        _add_result(_case(suite, diagnostic), diagnostic)
    for diagnostic in accepted:
        ET.SubElement(_case(suite, diagnostic), "skipped", message="accepted by policy.accept")
    if not total:
        ET.SubElement(suite, "testcase", classname="rarms", name="No findings")
    ET.indent(root)
    return '<?xml version="1.0" encoding="UTF-8"?>\n' + ET.tostring(root, encoding="unicode") + "\n"


def _case(suite: ET.Element, diagnostic: Diagnostic) -> ET.Element:
    location = (
        {} if diagnostic.place is None else {"file": _xml(diagnostic.place.file), "line": str(diagnostic.place.line)}
    )
    spot = diagnostic.address if diagnostic.place is None else str(diagnostic.place)
    name = _xml(
        f"{diagnostic.code} {diagnostic.summary} ({spot})" if spot else f"{diagnostic.code} {diagnostic.summary}"
    )
    classname = _xml(diagnostic.place.file if diagnostic.place else "rarms")
    return ET.SubElement(suite, "testcase", {"classname": classname, "name": name, **location})


def _add_result(case: ET.Element, diagnostic: Diagnostic) -> None:
    location = f"{diagnostic.place}, {diagnostic.place.path}\n" if diagnostic.place else ""
    text = _xml(f"{location}{diagnostic.detail}\n{diagnostic.advice!s}")
    if diagnostic.severity is Severity.ERROR:
        ET.SubElement(case, "failure", type=diagnostic.code, message=_xml(diagnostic.summary)).text = text
    else:
        ET.SubElement(case, "system-out").text = f"{diagnostic.severity.value}: {text}"


def _xml(text: str) -> str:
    """Return the text with what XML 1.0 has no way to write spelt out."""
    return visible(text).replace("\ufffe", "<U+FFFE>").replace("\uffff", "<U+FFFF>")


COMMANDS = {Severity.ERROR: "error", Severity.WARNING: "warning", Severity.NOTE: "notice"}


def as_github(diagnostics: Sequence[Diagnostic]) -> str:
    """Write one command a line; empty if there are no findings."""
    return "".join(
        f"::{COMMANDS[diagnostic.severity]} {_properties(diagnostic)}::{_message(diagnostic)}\n"
        for diagnostic in diagnostics
    )


def _properties(diagnostic: Diagnostic) -> str:
    properties: dict[str, str | int] = {}
    if diagnostic.place is not None:
        properties = {
            "file": PurePath(diagnostic.place.file).as_posix(),
            "line": diagnostic.place.line,
            "endLine": diagnostic.place.line,
            "col": diagnostic.place.column,
            "endColumn": diagnostic.place.column
            + max(diagnostic.place.length, 1)
            - 1,  # the last column itself: it defaults to col
        }
    properties["title"] = f"{diagnostic.code} {diagnostic.summary}"
    return ",".join(f"{name}={_property(str(value))}" for name, value in properties.items())


def _message(diagnostic: Diagnostic) -> str:
    return _data("\n".join(part for part in (diagnostic.detail, str(diagnostic.advice)) if part))


def _data(text: str) -> str:
    """Return the text as a command's message: per cent and line ends escaped, so that no text can begin a command."""
    return visible(text, keep="\r\n").replace("%", "%25").replace("\r", "%0D").replace("\n", "%0A")


def _property(text: str) -> str:
    """Return the text as a property's value: colon and comma would end it."""
    return _data(text).replace(":", "%3A").replace(",", "%2C")


_SECTIONS: Mapping[str, tuple[str, ...]] = {
    "partition": ("partitions", "components"),  # a partition without an entry has the name of a component
    "component": ("components",),
    "host": ("hosts",),
    "task": ("tasks",),
    "interference": ("interference",),
}
"""Sections of a manifest with the names of an address, or of a value of a finding."""


def with_places(diagnostics: Sequence[Diagnostic], places: Places) -> tuple[Diagnostic, ...]:
    """Give each finding without a place the line that names what it is about.

    Returns:
        The findings in their order. The place is the key of the partition, component, task class, load or host that
        the address or a value names; the manifest's first line, if the manifest names none of them.
    """
    return tuple(
        diagnostic if diagnostic.place is not None else replace(diagnostic, place=_place_of(diagnostic, places))
        for diagnostic in diagnostics
    )


def _place_of(diagnostic: Diagnostic, places: Places) -> Place:
    words = diagnostic.address.split("/")
    for kind, name in [*zip(words[::2], words[1::2], strict=False), *_named_in(diagnostic.values)]:
        for section in _SECTIONS.get(kind, ()):
            place, parent = places.key(section, name), places.key(section)
            if (place.file, place.line, place.column) != (parent.file, parent.line, parent.column):
                return place
    return places.key()


def _named_in(values: Mapping[str, Fact]) -> Iterator[tuple[str, str]]:
    """Yield kind and name of what the values name; the first of a list."""
    for kind in _SECTIONS:
        named = values.get(kind) or values.get(f"{kind}s")
        name = next(iter(named), None) if isinstance(named, tuple) else named
        if isinstance(name, str):
            yield kind, name
