"""Scripts of plans for `rarms show --script`: chosen, inspected, written out, compared."""

import hashlib
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path

import click

from rarms_iac.app.errors import Outcome, UseCaseError, not_written
from rarms_iac.app.files import read_file, write_file
from rarms_iac.apply.scripts import scripts_of
from rarms_iac.model.diagnostics import Diagnostic, Finding, Severity
from rarms_iac.model.plan import HostPlan, Plan
from rarms_iac.model.wording import suggestion
from rarms_iac.powershell.inspection.allowed import ScriptKind
from rarms_iac.powershell.inspection.inspect import inspect
from rarms_iac.powershell.outline import Outline, outline
from rarms_iac.powershell.render import script_name
from rarms_iac.storage.plan_file import MAX_BYTES, PlanFileError, read_plan

SCRIPT_ORIGIN = "rarms show --script PLAN --out FOLDER"

NO_SCRIPT = Finding(code="RARMS164", severity=Severity.ERROR, summary="This is not a script of rarms")

_KINDS = {
    "# rarms apply script.": ScriptKind.APPLY,
    "# rarms undo script:": ScriptKind.UNDO,
    "# rarms observe script:": ScriptKind.OBSERVE,
}


@dataclass(frozen=True, slots=True, kw_only=True)
class PlanScript:
    """One script of a plan."""

    name: str
    host: str
    guest: str  # a partition; empty: the host itself
    undo: bool
    text: str

    @property
    def kind(self) -> ScriptKind:
        """What it is for."""
        return ScriptKind.UNDO if self.undo else ScriptKind.APPLY

    @property
    def sha256(self) -> str:
        """Of its bytes."""
        return hashlib.sha256(self.text.encode("ascii")).hexdigest()


@dataclass(frozen=True, slots=True, kw_only=True)
class Choice:
    """Which scripts are meant."""

    hosts: tuple[str, ...] = ()  # none: all
    guest: str = ""
    undo: bool = False


def plan_scripts(plan: Plan) -> tuple[PlanScript, ...]:
    """Every script of the plan, by host, then name; for other hosts, what a Hyper-V host would get of the same steps.

    Raises:
        UseCaseError: one of them does not pass the inspection; it is not shown.
    """
    found = [script for part in plan.hosts for script in _of_host(part, _texts(part, plan))]
    wrong = [problem for script in found for problem in inspect(script.text.encode("ascii"), script.kind, script.name)]
    if wrong:
        raise UseCaseError(Outcome.FAILED, wrong)
    return tuple(found)


def chosen(scripts: Sequence[PlanScript], choice: Choice, plan: Plan) -> tuple[PlanScript, ...]:
    """Those that are meant: without a guest, the hosts' own.

    Raises:
        click.UsageError: the plan has no such host or guest.
    """
    names = [part.host.name for part in plan.hosts]
    for host in choice.hosts:
        if host not in names:
            raise _usage(f"The plan has no host {host!r}.{suggestion(host, names)} It has: {', '.join(names)}.")
    here = [script for script in scripts if script.host in (choice.hosts or names)]
    guests = sorted({script.guest for script in here if script.guest})
    if choice.guest and choice.guest not in guests:
        told = f"It has: {', '.join(guests)}." if guests else "It has none."
        raise _usage(f"The plan has no script for a guest {choice.guest!r}.{suggestion(choice.guest, guests)} {told}")
    return tuple(script for script in here if script.guest == choice.guest and script.undo is choice.undo)


def write_scripts(scripts: Sequence[PlanScript], folder: str) -> tuple[str, ...]:
    """The exact bytes as files in that folder, which is made; their paths.

    Raises:
        UseCaseError: the system does not let us.
    """
    try:
        Path(folder).mkdir(parents=True, exist_ok=True)
    except OSError as error:
        raise UseCaseError(Outcome.FAILED, [not_written(folder, error)]) from error
    paths = []
    for script in scripts:
        paths.append((Path(folder) / script.name).as_posix())
        write_file(paths[-1], script.text.encode("ascii"))
    return tuple(paths)


def check_file(path: str) -> tuple[str, tuple[Diagnostic, ...]]:
    """The text of a script that somebody edited, and what is wrong with it.

    Raises:
        UseCaseError: it cannot be read.
    """
    data = read_file(path, MAX_BYTES, SCRIPT_ORIGIN)
    text = data.decode("ascii", "replace")
    kind = kind_of(text)
    if kind is None:
        return text, (_no_script(path),)
    return text, inspect(data, kind, path)


def kind_of(text: str) -> ScriptKind | None:
    """What the script says in its head that it is for."""
    head = text[:2000].splitlines()
    return next((kind for start, kind in _KINDS.items() if any(line.startswith(start) for line in head)), None)


def outline_of(script: PlanScript) -> Outline:
    """What a script of a plan does."""
    return outline(script.text.encode("ascii"))


def outline_in(path: str, like: PlanScript) -> Outline:
    """What the script of this file does, or that of the same name in the plan that it is.

    Raises:
        UseCaseError: it is neither, or does not pass the inspection.
    """
    data = read_file(path, MAX_BYTES, SCRIPT_ORIGIN)
    if data.lstrip().startswith((b"{", b"\xef\xbb\xbf{")):
        try:
            scripts = {script.name: script for script in plan_scripts(read_plan(data))}
        except PlanFileError as error:
            raise UseCaseError(
                Outcome.REFUSED, [error.finding.at(None, f"{path}: {error.says}.", f"{error.advice}.")]
            ) from error
        if like.name not in scripts:
            raise _usage(f"{path} is a plan without a script {like.name}. It has: {', '.join(scripts) or 'none'}.")
        return outline_of(scripts[like.name])
    kind = kind_of(data.decode("ascii", "replace"))
    wrong = inspect(data, kind, path) if kind in {ScriptKind.APPLY, ScriptKind.UNDO} else (_no_script(path),)
    if wrong:
        raise UseCaseError(Outcome.FAILED, wrong)
    return outline(data)


def _texts(part: HostPlan, plan: Plan) -> Mapping[str, str]:
    if part.scripts:
        return part.scripts
    return {name: text.decode("ascii") for name, text in scripts_of(part, plan).items()}


def _of_host(part: HostPlan, texts: Mapping[str, str]) -> list[PlanScript]:
    begin = f"{script_name(part).removesuffix('.ps1')}.guest."
    found = []
    for name, text in sorted(texts.items()):
        undo = name.endswith(".undo.ps1")
        guest = name.removeprefix(begin).split(".")[0] if name.startswith(begin) else ""
        found.append(PlanScript(name=name, host=part.host.name, guest=guest, undo=undo, text=text))
    return found


def _no_script(path: str) -> Diagnostic:
    return NO_SCRIPT.at(
        None,
        f"{path} does not say in its head that it is an apply, undo or observe script of rarms.",
        "Give a script that `rarms show --script --out FOLDER` or `rarms snapshot --script` wrote.",
    )


def _usage(says: str) -> click.UsageError:
    return click.UsageError(says, click.get_current_context())
