"""The scripts of a plan: chosen, written out, compared, and checked after an edit."""

import hashlib
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Literal

from rarms_iac.app.applying import refuse_provisional
from rarms_iac.app.files import make_folder, read_input_file, write_file
from rarms_iac.app.plan_files import plan_in, plan_key
from rarms_iac.app.requests import refuse_unknown
from rarms_iac.app.use_case_errors import RequestError
from rarms_iac.model.commands import command
from rarms_iac.model.diagnostics import Diagnostic
from rarms_iac.model.host import ProviderKind
from rarms_iac.model.journal import Journal, RunKind, ScriptRun
from rarms_iac.model.output import output
from rarms_iac.model.plan import HostPlan, Plan
from rarms_iac.model.version import __version__
from rarms_iac.powershell.comparison import ScriptDifference, ScriptSteps, TextDifference, compare_steps, compare_texts
from rarms_iac.powershell.literals import unreadable
from rarms_iac.powershell.render import insides, render_observe, render_scripts, script_steps
from rarms_iac.powershell.templates import MODULE_FOLDER, NEW_MODULE, ScriptForm, shipped_module, without_signature
from rarms_iac.storage.plan_file import MAX_BYTES
from rarms_iac.texts.messages import quoted, suggestion

OBSERVE_NAME = "observe.ps1"
RECEIVE_NAME = "receive.ps1"
SCRIPT_ORIGIN = command("show", "PLAN", script=True, out="FOLDER")


@dataclass(frozen=True, slots=True, kw_only=True)
class PlanScript:
    """One script of a plan."""

    name: str
    host: str
    guest: str  # a partition; empty: the host itself
    undo: bool
    text: str

    @output
    def sha256(self) -> str:
        """The SHA-256 digest of the script's bytes, in hexadecimal."""
        return hashlib.sha256(self.text.encode("ascii")).hexdigest()


@dataclass(frozen=True, slots=True, kw_only=True)
class PlanScripts:
    """Scripts of a plan that were asked for."""

    kind: Literal["scripts"] = "scripts"
    plan: str  # id
    scripts: tuple[PlanScript, ...]


@dataclass(frozen=True, slots=True, kw_only=True)
class ScriptSelection:
    """The choice of a plan's scripts."""

    hosts: tuple[str, ...] = ()  # none: all
    guest: str = ""  # a partition; empty: the hosts' own
    undo: bool = False


def plan_scripts(plan: Plan, form: ScriptForm = ScriptForm.MODULE) -> tuple[PlanScript, ...]:
    """Return every script of the plan by host, then by name; a plan file holds those of the module form.

    A simulated host has those that a Hyper-V host would have for the same steps. A Linux host has none.

    Raises:
        RequestError: the plan is signed with a key, and none is set: its scripts carry a signature of that key.
    """
    if plan.signature and plan_key() is None:
        raise RequestError(
            f"Plan {plan.id} and its scripts are signed with a key. No key is set here.",
            "Set RARMS_PLAN_KEY or RARMS_PLAN_KEY_FILE.",
        )
    return tuple(script for part in plan.hosts for script in _of_host(part, _texts(part, plan, form)))


def select_scripts(scripts: Sequence[PlanScript], selection: ScriptSelection, plan: Plan) -> tuple[PlanScript, ...]:
    """Return those of a plan's scripts that a selection asks for; without a guest, the hosts' own.

    Raises:
        RequestError: the plan has no such host or guest.
    """
    names = [part.host.name for part in plan.hosts]
    refuse_unknown(selection.hosts, names, "host", "The plan")
    here = [script for script in scripts if script.host in (selection.hosts or names)]
    guests = sorted({script.guest for script in here if script.guest})
    guest = selection.guest
    if guest and guest not in guests:
        others = f"It has: {', '.join(guests)}." if guests else "It has none."
        raise RequestError(
            f"The plan does not have a script for the guest {quoted(guest)}.{suggestion(guest, guests)} {others}"
        )
    return tuple(script for script in here if script.guest == guest and script.undo is selection.undo)


def only_script(selected: Sequence[PlanScript], option: str) -> PlanScript:
    """Return the script that an option takes.

    Raises:
        RequestError: none is selected, or more than one.
    """
    if len(selected) == 1:
        return selected[0]
    hosts = ", ".join(script.host for script in selected)
    problem = f"{hosts} have one each" if selected else "the plan does not have one"
    raise RequestError(f"{option} needs exactly one script, but {problem}. Choose one with --host.")


def scripts_to_write(
    plan: Plan, scripts: Sequence[PlanScript], selected: Sequence[PlanScript], selection: ScriptSelection
) -> tuple[PlanScript, ...]:
    """Return the scripts of a plan that are written: all of the selected hosts.

    Where a guest or an undo is asked for: the selected script and the one that reverses it.

    Raises:
        UseCaseError: the plan sets provisional reservations without consent (refused), as `apply` refuses it.
    """
    refuse_provisional(plan)
    if not selection.guest and not selection.undo:
        return tuple(script for script in scripts if not selection.hosts or script.host in selection.hosts)
    pairs = {(script.host, script.guest) for script in selected}
    return tuple(script for script in scripts if (script.host, script.guest) in pairs)


def write_scripts(scripts: Sequence[PlanScript], folder: str) -> tuple[str, ...]:
    """Write the exact bytes to a folder, which is made, and return the paths: the scripts in order, then the module.

    The module is written if a script does not hold it. A module that differs by its signature alone stays. A file
    `.gitattributes` keeps git from changing line ends.

    Raises:
        UseCaseError: the system refuses it.
    """
    make_folder(folder)
    paths = []
    for script in scripts:
        paths.append((Path(folder) / script.name).as_posix())
        write_file(paths[-1], script.text.encode("ascii"))
    if any(NEW_MODULE not in script.text for script in scripts):
        paths += _write_module(Path(folder) / MODULE_FOLDER)
    attributes = Path(folder) / ".gitattributes"
    if not attributes.exists():
        write_file(attributes.as_posix(), b"*.ps1 -text\n*.psd1 -text\n*.psm1 -text\n")
    return tuple(paths)


def write_installable_module(folder: str, receiver: str) -> tuple[str, ...]:
    """Write the folder `Rarms` as it lies among the modules of a host, and return the paths.

    It has `receive.ps1`, whose text with CRLF is given, and this version's module.

    Raises:
        UseCaseError: the system refuses it.
    """
    above = Path(folder) / MODULE_FOLDER
    make_folder(above.as_posix())
    start = (above / RECEIVE_NAME).as_posix()
    write_file(start, receiver.encode("ascii"))
    return (start, *_write_module(above / __version__))


def _write_module(folder: Path) -> list[str]:
    """Write the module and what `Get-RarmsObservation` runs; a file that was signed since then stays."""
    make_folder(folder.as_posix())
    paths = []
    for name, text in {**shipped_module(), OBSERVE_NAME: observe_script()}.items():
        path = folder / name
        if not path.exists() or _read_script(path.as_posix()) != text.encode("ascii"):
            write_file(path.as_posix(), text.encode("ascii"))
        paths.append(path.as_posix())
    return paths


def check_script(path: str) -> tuple[str, tuple[Diagnostic, ...]]:
    """Return the text of a script that was edited, without a signature, and why not every PowerShell can read it.

    Raises:
        UseCaseError: the file cannot be read.
    """
    data = _read_script(path)
    return data.decode("ascii", "replace"), unreadable(data, path)


def _read_script(path: str) -> bytes:
    """Return the bytes of a script's file, without what signing it added."""
    data = read_input_file(path, MAX_BYTES, SCRIPT_ORIGIN)
    return without_signature(data.decode("latin-1")).encode("latin-1")


def compare_with_file(path: str, plan: Plan, script: PlanScript) -> ScriptDifference | TextDifference:
    """Compare a script of a plan with another plan's, step by step, or with a script file, line by line.

    Raises:
        RequestError: the file is a plan without such a script.
        UseCaseError: the file cannot be read, or is a plan that was edited.
    """
    data = _read_script(path)
    if not data.lstrip().startswith((b"{", b"\xef\xbb\xbf{")):
        return compare_texts(data.decode("ascii", "replace"), script.text, (path, script.name))
    old = plan_in(path, data)
    difference = compare_plans(old, plan, script, path)
    if difference is None:
        names = ", ".join(script.name for script in plan_scripts(old)) or "none"
        raise RequestError(f"{path} is a plan without a script {script.name}. It has: {names}.")
    return difference


def compare_plans(old: Plan, new: Plan, script: PlanScript, name: str) -> ScriptDifference | None:
    """Compare a script of the new plan with that of the old one, which has this name; None: it has no such script."""
    before, after = _steps_of(old, script), _steps_of(new, script)
    return compare_steps(before, after, (name, script.name)) if before and after else None


def _steps_of(plan: Plan, script: PlanScript) -> ScriptSteps | None:
    part = next((part for part in plan.hosts if part.host.name == script.host), None)
    if part is None or script.guest not in insides(part):
        return None
    return ScriptSteps(plan=plan.id, steps=script_steps(part, plan, script.guest, undo=script.undo))


@dataclass(frozen=True, slots=True, kw_only=True)
class ScriptSince:
    """A script of a plan, and how it differs from the one that was applied last."""

    script: PlanScript
    applied: str  # id of the plan of the last apply; empty: there was none that rarms walked
    difference: ScriptDifference | None  # None: that plan had no script of this name


def scripts_since(plan: Plan, runs: Mapping[str, Journal | ScriptRun | None]) -> tuple[ScriptSince, ...]:
    """Return the plan's scripts without those that undo, each with its difference from the last run on its host."""
    last = {
        name: replace(plan, id=run.started.plan, hosts=(run.started.host_plan,))
        for name, run in runs.items()
        if isinstance(run, Journal) and run.started.run is RunKind.APPLY and run.started.application == plan.application
    }
    return tuple(
        ScriptSince(
            script=script,
            applied=last[script.host].id if script.host in last else "",
            difference=compare_plans(last[script.host], plan, script, script.name) if script.host in last else None,
        )
        for script in plan_scripts(plan)
        if not script.undo
    )


def observe_script() -> str:
    """Return `observe.ps1`, which looks at a Hyper-V host or into a guest and changes nothing: ASCII with CRLF."""
    return render_observe().decode("ascii")


def _texts(part: HostPlan, plan: Plan, form: ScriptForm) -> Mapping[str, str]:
    if part.scripts and form is ScriptForm.MODULE:
        return part.scripts
    if part.facts.provider is ProviderKind.LINUX:
        return {}
    return {name: text.decode("ascii") for name, text in render_scripts(part, plan, form).items()}


def _of_host(part: HostPlan, texts: Mapping[str, str]) -> list[PlanScript]:
    begin = f"{part.host.name}.guest."
    scripts = []
    for name, text in sorted(texts.items()):
        undo = name.endswith(".undo.ps1")
        guest = name.removeprefix(begin).split(".")[0] if name.startswith(begin) else ""
        scripts.append(PlanScript(name=name, host=part.host.name, guest=guest, undo=undo, text=text))
    return scripts
