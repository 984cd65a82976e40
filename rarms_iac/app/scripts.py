"""The scripts of a plan: chosen, inspected, written out, compared, and checked after an edit."""

import hashlib
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Literal

from rarms_iac.app.files import make_folder, read_input_file, write_file
from rarms_iac.app.plan_files import plan_in
from rarms_iac.app.use_case_errors import Outcome, RequestError, UseCaseError
from rarms_iac.applying.scripts import scripts_of
from rarms_iac.model.commands import command, prose
from rarms_iac.model.diagnostics import Diagnostic, Finding, Place
from rarms_iac.model.host import ProviderKind
from rarms_iac.model.journal import Journal, RunKind, ScriptRun
from rarms_iac.model.output import output
from rarms_iac.model.plan import HostPlan, Plan
from rarms_iac.model.version import __version__
from rarms_iac.model.wording import quoted, suggestion
from rarms_iac.powershell.inspection.inspect import inspect
from rarms_iac.powershell.inspection.parts import NEW_MODULE, RUNTIME
from rarms_iac.powershell.outline import Outline, ScriptDifference, difference, outline
from rarms_iac.powershell.render import render_observe
from rarms_iac.powershell.templates import (
    ENTRY,
    MEASURING_ENTRY,
    MODULE_FOLDER,
    ScriptForm,
    shipped_module,
    without_signature,
)
from rarms_iac.storage.plan_file import MAX_BYTES

OBSERVE_NAME = "observe.ps1"
RECEIVE_NAME = "receive.ps1"
SCRIPT_ORIGIN = command("show", "PLAN", script=True, out="FOLDER")

NO_SCRIPT = Finding.error("RARMS164", "This is not a script of rarms")

_ENTRIES = {
    "    rarms apply script:": ENTRY,
    "    rarms undo script:": ENTRY,
    "    rarms measure script:": MEASURING_ENTRY,
}
"""By the first line of a script's help: the function that its end calls."""

_OBSERVE_HEAD = b"# rarms observe script:"
_HEAD = 2000  # bytes in which a script says what it is


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
    """Which scripts of a plan are meant."""

    hosts: tuple[str, ...] = ()  # none: all
    guest: str = ""  # a partition; empty: the hosts' own
    undo: bool = False


def plan_scripts(plan: Plan, form: ScriptForm = ScriptForm.MODULE) -> tuple[PlanScript, ...]:
    """Make every script of the plan; for simulated hosts, what a Hyper-V host would get of the same steps.

    Args:
        form: of the scripts; a plan holds those of the module form.

    Returns:
        The scripts by host, then by name; of a Linux host none. They are not inspected yet: `inspect_scripts` does that
            with those that are shown or written.
    """
    return tuple(script for part in plan.hosts for script in _of_host(part, _texts(part, plan, form)))


def inspect_scripts(scripts: Sequence[PlanScript]) -> None:
    """Refuse scripts that must not be shown or written.

    Args:
        scripts: of a plan, as rarms made them, or edited since.

    Raises:
        UseCaseError: one of them does not pass the inspection (failed).
    """
    wrong = [problem for script in scripts for problem in inspect(script.text.encode("ascii"), script.name)]
    if wrong:
        raise UseCaseError(Outcome.FAILED, wrong)


def select_scripts(scripts: Sequence[PlanScript], selection: ScriptSelection, plan: Plan) -> tuple[PlanScript, ...]:
    """Choose the scripts that a selection asks for; without a guest, the hosts' own.

    Args:
        scripts: all of the plan (`plan_scripts`).
        selection: the hosts, guest and undo that were asked for.
        plan: names the hosts; a host without changes has no script.

    Returns:
        Those, in the plan's order.

    Raises:
        RequestError: the plan has no such host or guest.
    """
    names = [part.host.name for part in plan.hosts]
    for host in selection.hosts:
        if host not in names:
            raise RequestError(
                f"The plan has no host {quoted(host)}.{suggestion(host, names)} It has: {', '.join(names)}."
            )
    here = [script for script in scripts if script.host in (selection.hosts or names)]
    guests = sorted({script.guest for script in here if script.guest})
    guest = selection.guest
    if guest and guest not in guests:
        others = f"It has: {', '.join(guests)}." if guests else "It has none."
        raise RequestError(f"The plan has no script for a guest {quoted(guest)}.{suggestion(guest, guests)} {others}")
    return tuple(script for script in here if script.guest == guest and script.undo is selection.undo)


def only_script(selected: Sequence[PlanScript], option: str) -> PlanScript:
    """The script that an option takes, of those that are meant.

    Args:
        selected: as `select_scripts` returns them.
        option: its name, for the message.

    Returns:
        That script.

    Raises:
        RequestError: there is none, or more than one.
    """
    if len(selected) == 1:
        return selected[0]
    hosts = ", ".join(script.host for script in selected)
    problem = f"those of {hosts} are meant" if selected else "the plan has none of that kind"
    raise RequestError(f"{option} takes one script, and {problem}: choose with --host.")


def scripts_to_write(
    scripts: Sequence[PlanScript], selected: Sequence[PlanScript], selection: ScriptSelection
) -> tuple[PlanScript, ...]:
    """Choose which scripts of a plan are written.

    Args:
        scripts: all scripts of the plan.
        selected: those that the selection picks to be shown.
        selection: the hosts, guest and undo that were asked for.

    Returns:
        All scripts of the selected hosts. Where a guest or an undo was asked for: that script and the one that reverses
            it, since neither is of use alone.
    """
    if not selection.guest and not selection.undo:
        return tuple(script for script in scripts if not selection.hosts or script.host in selection.hosts)
    pairs = {(script.host, script.guest) for script in selected}
    return tuple(script for script in scripts if (script.host, script.guest) in pairs)


def write_scripts(scripts: Sequence[PlanScript], folder: str) -> tuple[str, ...]:
    """The exact bytes as files in that folder, which is made; their paths.

    Beside them lie the module of those that do not hold it, and what keeps git from changing line ends, where there is
    no such file yet. A module there that differs by its signature alone stays.

    Args:
        scripts: as `select_scripts` returns them.
        folder: as the user gave it.

    Returns:
        A path for each script, in order, then for each file of the module.

    Raises:
        UseCaseError: the system does not let us.
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
    """The folder `Rarms` as it lies among the modules of a host: what starts the receiver, and this version's module.

    Args:
        folder: as the user gave it; it is made.
        receiver: the text of `receive.ps1`, with CRLF.

    Returns:
        The paths of the files.

    Raises:
        UseCaseError: the system does not let us.
    """
    above = Path(folder) / MODULE_FOLDER
    make_folder(above.as_posix())
    start = (above / RECEIVE_NAME).as_posix()
    write_file(start, receiver.encode("ascii"))
    return (start, *_write_module(above / __version__))


def _write_module(folder: Path) -> list[str]:
    """The module's files, and beside them what `Get-RarmsObservation` runs; a file that was signed since is left."""
    make_folder(folder.as_posix())
    paths = []
    for name, text in {**shipped_module(), OBSERVE_NAME: observe_script()}.items():
        path = folder / name
        if not path.exists() or _read_script(path.as_posix()) != text.encode("ascii"):
            write_file(path.as_posix(), text.encode("ascii"))
        paths.append(path.as_posix())
    return paths


def check_script(path: str) -> tuple[str, tuple[Diagnostic, ...]]:
    """The text of a script that was edited, and what is wrong with it.

    Args:
        path: as the user gave it.

    Returns:
        The text, and findings in the order of its lines; none: it may run.

    Raises:
        UseCaseError: it cannot be read.
    """
    data = _read_script(path)
    return data.decode("ascii", "replace"), _problems_of(path, data)


def _problems_of(path: str, data: bytes) -> tuple[Diagnostic, ...]:
    if _OBSERVE_HEAD in data[:_HEAD]:
        return () if data == render_observe() else (_edited_observe(path),)
    entry = _entry_of(data)
    return (_no_script(path),) if entry is None else inspect(data, path, entry=entry)


def _read_script(path: str) -> bytes:
    """The bytes of a script's file, without what signing it added."""
    data = read_input_file(path, MAX_BYTES, SCRIPT_ORIGIN)
    return without_signature(data.decode("latin-1")).encode("latin-1")


def _entry_of(data: bytes) -> str | None:
    """The function that the script's end calls, by what its help says that it is."""
    head = data[:_HEAD].decode("ascii", "replace").splitlines()
    return next((entry for start, entry in _ENTRIES.items() if any(line.startswith(start) for line in head)), None)


def compare_with_file(path: str, script: PlanScript) -> ScriptDifference:
    """How a script of a plan differs, step by step, from the script or the plan in a file.

    Args:
        path: as the user gave it.
        script: of a plan.

    Returns:
        The steps that only one has, or that differ.

    Raises:
        RequestError: the file is a plan without such a script.
        UseCaseError: it is neither, was edited, or does not pass the inspection.
    """
    return replace(difference(_outline_in(path, script), _outline_of(script)), old=path, new=script.name)


def compare_scripts(old: PlanScript, new: PlanScript) -> ScriptDifference:
    """How a script of a plan differs, step by step, from one of another plan.

    Args:
        old: of the other plan.
        new: of this one.

    Returns:
        The steps that only one has, or that differ.
    """
    return replace(difference(_outline_of(old), _outline_of(new)), old=old.name, new=new.name)


@dataclass(frozen=True, slots=True, kw_only=True)
class ScriptSince:
    """A script of a plan, beside the one that was applied last."""

    script: PlanScript
    applied: str  # id of the plan of the last apply; empty: there was none that rarms walked
    difference: ScriptDifference | None  # None: that plan had no script of this name


def scripts_since(plan: Plan, runs: Mapping[str, Journal | ScriptRun | None]) -> tuple[ScriptSince, ...]:
    """Make the plan's own scripts, each with the difference to what was applied last.

    Args:
        runs: by host, the last run there.

    Returns:
        The scripts of hosts and guests, without those that undo; of a Linux host none.
    """
    last = {
        name: run.started
        for name, run in runs.items()
        if isinstance(run, Journal) and run.started.run is RunKind.APPLY and run.started.application == plan.application
    }
    before = {
        script.name: script
        for started in last.values()
        for script in plan_scripts(replace(plan, id=started.plan, hosts=(started.host_plan,)))
    }
    return tuple(
        ScriptSince(
            script=script,
            applied=last[script.host].plan if script.host in last else "",
            difference=compare_scripts(before[script.name], script) if script.name in before else None,
        )
        for script in plan_scripts(plan)
        if not script.undo
    )


def observe_script() -> str:
    """`observe.ps1`: what looks at a Hyper-V host or into a guest, and changes nothing.

    Returns:
        ASCII text with CRLF.
    """
    return render_observe().decode("ascii")


def _outline_of(script: PlanScript) -> Outline:
    return outline(script.text.encode("ascii"))


def _outline_in(path: str, like: PlanScript) -> Outline:
    """What the script of this file does, or that of the same name in the plan that it is."""
    data = _read_script(path)
    if data.lstrip().startswith((b"{", b"\xef\xbb\xbf{")):
        scripts = {script.name: script for script in plan_scripts(plan_in(path, data))}
        if like.name not in scripts:
            names = ", ".join(scripts) or "none"
            raise RequestError(f"{path} is a plan without a script {like.name}. It has: {names}.")
        inspect_scripts([scripts[like.name]])
        return _outline_of(scripts[like.name])
    if wrong := inspect(data, path) if _entry_of(data) == ENTRY else (_no_script(path),):
        raise UseCaseError(Outcome.FAILED, wrong)
    return outline(data)


def _texts(part: HostPlan, plan: Plan, form: ScriptForm) -> Mapping[str, str]:
    if part.scripts and form is ScriptForm.MODULE:
        return part.scripts
    if part.facts.provider is ProviderKind.LINUX:
        return {}
    return {name: text.decode("ascii") for name, text in scripts_of(part, plan, form).items()}


def _of_host(part: HostPlan, texts: Mapping[str, str]) -> list[PlanScript]:
    begin = f"{part.host.name}.guest."
    scripts = []
    for name, text in sorted(texts.items()):
        undo = name.endswith(".undo.ps1")
        guest = name.removeprefix(begin).split(".")[0] if name.startswith(begin) else ""
        scripts.append(PlanScript(name=name, host=part.host.name, guest=guest, undo=undo, text=text))
    return scripts


def _edited_observe(path: str) -> Diagnostic:
    place = Place(file=path, line=1, column=1)
    return RUNTIME.at(place, "it is not the observe script that rarms ships", "write it again", file=path)


def _no_script(path: str) -> Diagnostic:
    return NO_SCRIPT.at(
        None,
        "{file} does not say in its head that it is an apply, undo or observe script of rarms.",
        prose(
            "Give a script that ",
            command("show", script=True, out="FOLDER"),
            " or ",
            command("snapshot", script=True),
            " wrote.",
        ),
        file=path,
    )
