"""Scripts of a plan: `rarms show --script`, and with --against."""

from dataclasses import dataclass
from typing import Literal

from rarms_iac.views.output.common import FORMAT_VERSION, Format


@dataclass(frozen=True, slots=True, kw_only=True)
class ScriptOutput:
    """A script of a plan, to the byte; `guest` is empty where it runs on the host itself."""

    name: str
    host: str
    guest: str
    undo: bool
    sha256: str
    text: str


@dataclass(frozen=True, slots=True, kw_only=True)
class ScriptsOutput:
    """`rarms show --script`."""

    plan: str
    scripts: tuple[ScriptOutput, ...]
    kind: Literal["scripts"] = "scripts"
    format_version: Format = FORMAT_VERSION


@dataclass(frozen=True, slots=True, kw_only=True)
class ScriptDetailOutput:
    """A reading, parameter or fact of the run that differs; null: it is not there."""

    name: str
    old: str | None
    new: str | None


@dataclass(frozen=True, slots=True, kw_only=True)
class ScriptStepOutput:
    """A step that differs; its number in each script, from 1, null where it is not there."""

    address: str
    action: str
    old: int | None
    new: int | None
    moved: bool
    details: tuple[ScriptDetailOutput, ...]


@dataclass(frozen=True, slots=True, kw_only=True)
class ScriptDifferenceOutput:
    """`rarms show --script --against`: what differs step by step."""

    old: str
    new: str
    run: tuple[ScriptDetailOutput, ...]
    steps: tuple[ScriptStepOutput, ...]
    same: int
    kind: Literal["script_difference"] = "script_difference"
    format_version: Format = FORMAT_VERSION
