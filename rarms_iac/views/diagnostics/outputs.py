"""Which form of the findings goes where: `--output sarif=findings.sarif --output text`."""

from collections.abc import Sequence
from dataclasses import dataclass
from enum import StrEnum

from rarms_iac.model.wording import suggestion


class OutputFormat(StrEnum):
    """The forms that findings can take."""

    TEXT = "text"
    JSON = "json"
    SARIF = "sarif"
    JUNIT = "junit"
    GITHUB = "github"


@dataclass(frozen=True, slots=True, kw_only=True)
class Output:
    """One form and the file it goes to; None is standard output."""

    format: OutputFormat
    path: str | None = None


class BadOutput(ValueError):
    """What `--output` says cannot be done; the message says what can."""


def parse_outputs(values: Sequence[str]) -> tuple[Output, ...]:
    """The outputs of a run, in order; text on standard output where none is named.

    Raises:
        BadOutput: an unknown form, an empty file name, or two outputs to one place.
    """
    outputs = tuple(map(_output, values)) or (Output(format=OutputFormat.TEXT),)
    places = [output.path for output in outputs]
    for place in places:
        if places.count(place) > 1:
            where = "standard output" if place is None else place
            raise BadOutput(f"two outputs go to {where}: give each a file of its own, as in sarif=findings.sarif")
    return outputs


def _output(value: str) -> Output:
    name, equals, path = value.partition("=")
    formats = [one.value for one in OutputFormat]
    if name not in formats:
        raise BadOutput(f"{name!r} is no form of output.{suggestion(name, formats)} There are {', '.join(formats)}.")
    if equals and not path:
        raise BadOutput(f"{value!r} names no file: write {name}=FILE, or {name} alone for standard output")
    return Output(format=OutputFormat(name), path=None if path in {"", "-"} else path)
