"""A script that changes something is a head of comments, the fixed runtime part, and steps: nothing else."""

import hashlib
from collections.abc import Iterator
from dataclasses import dataclass

from rarms_iac.model.diagnostics import Diagnostic, Finding, Place, Severity
from rarms_iac.powershell.environment import BEGIN, END, read, runtime
from rarms_iac.powershell.tokens import NotTokens, TokenKind, tokens

RUNTIME = Finding(code="RARMS202", severity=Severity.ERROR, summary="The fixed part of a script was changed")
HEAD = Finding(
    code="RARMS219", severity=Severity.ERROR, summary="The head or the end of a script is not as rarms writes it"
)

_REQUIRED = ("-Version 5.1", "-RunAsAdministrator")
_OPTIONAL = ("-Modules Hyper-V",)


@dataclass(frozen=True, slots=True, kw_only=True)
class Parts:
    """The three parts of a script, with LF; `steps_line`: the line before the steps' first one."""

    head: str
    runtime: str
    steps: str
    steps_line: int


def split(text: str) -> Parts:
    """The parts of a script; where the runtime's first or last line is missing, it has no runtime and no steps."""
    lines = text.replace("\r\n", "\n").split("\n")
    begin = next((at for at, line in enumerate(lines) if line.startswith(BEGIN)), None)
    end = next((at for at, line in enumerate(lines) if line.startswith(END)), None)
    if begin is None or end is None or end < begin:
        return Parts(head="\n".join(lines), runtime="", steps="", steps_line=len(lines))
    return Parts(
        head="\n".join(lines[:begin]) + "\n",
        runtime="\n".join(lines[begin : end + 1]),
        steps="\n".join(lines[end + 1 :]),
        steps_line=end + 1,
    )


def check_layout(name: str, parts: Parts) -> Iterator[Diagnostic]:
    """The head holds comments only and asks for what the runtime needs; the runtime is the one that rarms ships."""
    place = Place(file=name, line=1, column=1)
    if digest(parts.runtime) != digest(runtime()):
        detail = f"its SHA-256 is {digest(parts.runtime)[:12]}, not {digest(runtime())[:12]}"
        yield RUNTIME.at(place, detail, "render the script again; only its steps may differ from another's")
    for says in _head_problems(parts.head):
        yield HEAD.at(place, says, "render the script again")
    if parts.steps and not parts.steps.endswith(_tail()):
        yield HEAD.at(place, "the last lines are not those of a script of rarms", "render the script again")


def check_end(name: str, text: str) -> Iterator[Diagnostic]:
    """A read-only script ends with its exit code: what stood behind would be read and never run."""
    if not text.endswith("\r\nexit 0\r\n"):
        place = Place(file=name, line=text.count("\n"), column=1)
        yield HEAD.at(place, "the script does not end with exit 0", "render the script again")


def check_whole(name: str, text: str, shipped: str) -> Iterator[Diagnostic]:
    """A script that is always the same has the bytes that rarms ships."""
    if text.replace("\r\n", "\n") != shipped:
        place = Place(file=name, line=1, column=1)
        yield RUNTIME.at(place, "it is not the bootstrap that rarms ships", "take the one that rarms shows")


def digest(text: str) -> str:
    """SHA-256 of a part's text."""
    return hashlib.sha256(text.encode("utf-8", "surrogatepass")).hexdigest()


def _head_problems(head: str) -> Iterator[str]:
    try:
        found = tokens(head)
    except NotTokens:
        found = ()
    if not found or any(one.kind not in (TokenKind.COMMENT, TokenKind.NEWLINE) for one in found):
        yield "there is more than comments before the runtime"
    comments = [one.text for one in found if one.kind is TokenKind.COMMENT]
    if any(one.startswith("<#") or one.lower().startswith("# sig #") for one in comments):
        yield "a comment in it may be read by PowerShell"
    asked = [one[len("#requires ") :] for one in comments if one.lower().startswith("#requires")]
    if not set(_REQUIRED) <= set(asked) <= {*_REQUIRED, *_OPTIONAL}:
        yield f"it asks for {', '.join(asked) or 'nothing'}"


def _tail() -> str:
    """What follows the last step in the template."""
    return read("apply.ps1.j2").rpartition("{% endfor %}\n")[2]
