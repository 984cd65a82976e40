"""The module that scripts call: what may stand in for it, what it refuses, what -Test gives, what a journal keeps."""

from collections.abc import Callable, Mapping
from dataclasses import replace

import pytest

from rarms_iac.applying.execute import finish_unfinished
from rarms_iac.applying.run_report import RunEnding, RunReporter
from rarms_iac.applying.run_steps import RunControl
from rarms_iac.model.plan import Plan, Purpose
from rarms_iac.powershell.templates import MODULE_FILES, MODULE_FOLDER, module_digest, module_digests, shipped_module
from rarms_iac.providers.hyperv.provider import LiveHypervHost
from tests.builders import a_host
from tests.fake_powershell.cell import apply, apply_script, files_of, in_one_file, scripts_of, with_module
from tests.fake_powershell.cells import everything, fresh
from tests.fake_powershell.host import WindowsHost
from tests.fake_powershell.observing import seen
from tests.fake_powershell.run import FOLDER, put, run
from tests.fake_powershell.signing import signed
from tests.fake_powershell.transport import FakePowerShellTransport
from tests.fake_powershell.values import Thing, Value

MODULE = f"{MODULE_FOLDER}/Rarms.psm1"


@pytest.mark.parametrize("single", [False, True], ids=["module", "single file"])
@pytest.mark.parametrize("name", ["Test-Wanted", "Initialize-Run", "Compare-Reading", "Write-Failure"])
def test_callers_alias_is_named_first(name: str, single: bool) -> None:
    prepared = fresh()
    plan = in_one_file(prepared.plan) if single else prepared.plan
    host = prepared.copy(aliases={name.lower(): "Write-Output"})

    ran = apply(host, plan)

    assert (ran.code, host.effects) == (1, []), ran.says
    assert f"an alias hides a function of rarms; remove it: {name.lower()}" in ran.says


def without(name: str) -> Callable[[Mapping[str, bytes]], Mapping[str, bytes]]:
    return lambda files: {at: data for at, data in files.items() if at != name}


def changed(name: str, change: Callable[[bytes], bytes]) -> Callable[[Mapping[str, bytes]], Mapping[str, bytes]]:
    return lambda files: {**files, name: change(files[name])}


@pytest.mark.parametrize(
    ("change", "code"),
    [
        (without(MODULE), 1),
        (changed(MODULE, lambda data: data.replace(b"-cne $plan.Identity", b"-ceq $plan.Identity")), 1),
        (changed(MODULE, lambda data: data.replace(b"\r\n", b"\n")), 1),
        (changed(MODULE, lambda data: data + b"Remove-Item C:\\\r\n"), 1),
        (changed(MODULE, lambda data: signed(data) + b"Remove-Item C:\\\r\n"), 1),
        (changed(f"{MODULE_FOLDER}/Rarms.psd1", lambda data: data.replace(b"0.1.0", b"0.1.1")), 1),
        (changed(MODULE, signed), 0),
        (lambda files: {name: signed(data) for name, data in files.items()}, 0),
    ],
    ids=[
        "missing",
        "edited",
        "line ends",
        "a line more",
        "a line behind the block",
        "manifest",
        "signed",
        "all signed",
    ],
)
def test_only_the_named_module_is_imported(
    change: Callable[[Mapping[str, bytes]], Mapping[str, bytes]], code: int
) -> None:
    prepared = fresh()
    host = prepared.copy()
    put(host, change(files_of(prepared.plan)))

    ran = run(host, apply_script(prepared.plan))

    assert ran.code == code, ran.says
    if code:
        assert host.effects == []
        assert "Rarms.ps" in ran.says


@pytest.mark.parametrize("what", ["nothing", "script", "module", "undo"])
def test_signature_policy_needs_script_and_module_signed(what: str) -> None:
    prepared = fresh()
    host = prepared.copy(all_signed=True)
    unsigned = {"script": apply_script(prepared.plan), "module": MODULE}.get(what, "")
    files = {name: data if name == unsigned else signed(data) for name, data in files_of(prepared.plan).items()}
    if what == "undo":  # the apply script does not run it
        files |= {name: data for name, data in scripts_of(prepared.plan).items() if ".undo." in name}
    put(host, files)

    ran = run(host, apply_script(prepared.plan))

    assert ran.code == (0 if what in {"nothing", "undo"} else 1), ran.says
    assert (host.effects == []) is (ran.code == 1)


def state_of(host: WindowsHost, plan: Plan) -> list[tuple[Value, Value, Value]]:
    """What -Test gives: address, whether it is as wanted, what it takes."""
    given: list[Value] = []
    before = len(host.effects)
    ran = run(host, apply_script(plan), as_json=False, test=True, output=given)
    assert ran.code == 0, ran.says
    assert len(host.effects) == before
    things = [thing for thing in given if isinstance(thing, Thing)]
    assert len(things) == len(given)
    return [(thing.get("Address"), thing.get("InDesiredState"), thing.get("Disruption")) for thing in things]


def test_test_reports_each_step_and_writes_nothing() -> None:
    made = fresh()
    host = made.furnished()

    before = state_of(host, made.plan)
    assert apply(host, made.plan).code == 0
    after = state_of(host, made.plan)
    removal = made.cell.on(host).plan(purpose=Purpose.DESTROY, remove_disks=True)
    put(host, files_of(removal))
    taken = state_of(host, removal)

    assert {wanted for _, wanted, _ in before} == {False}
    assert {wanted for _, wanted, _ in after} == {True}
    assert [address for address, _, _ in before] == [address for address, _, _ in after]
    assert {"stops", "removes", "deletes"} <= {disruption for _, _, disruption in taken}


@pytest.mark.parametrize("single", [False, True], ids=["module", "single file"])
@pytest.mark.parametrize("at_prompt", [False, True], ids=["-File", "at a prompt"])
@pytest.mark.parametrize("case", ["creation", "removal", "everything"])
def test_preview_by_file_and_at_prompt_changes_nothing(case: str, at_prompt: bool, single: bool) -> None:
    """`.\\x.ps1 -WhatIf` at a prompt reaches no module by itself; the script hands its preference over."""
    prepared = everything() if case == "everything" else fresh()
    host, plan = prepared.copy(), prepared.plan
    if case == "removal":
        apply(host, plan)
        plan = prepared.cell.on(host).plan(purpose=Purpose.DESTROY)
    plan = in_one_file(plan) if single else plan
    put(host, scripts_of(plan) if single else files_of(plan))
    host.effects = []

    before, entries = seen(host), list(host.event_log or ())

    ran = run(host, apply_script(plan), what_if=True, at_prompt=at_prompt)

    assert (ran.code, host.effects) == (0, []), ran.says
    assert (seen(host), host.event_log) == (before, entries)
    assert {event["status"] for event in ran.events} <= {"previewed", "unchanged"}
    assert ran.events[-1]["status"] == "previewed"


def of_an_older_module(plan: Plan) -> tuple[Plan, Mapping[str, bytes]]:
    """The plan as another version made it, with that version's module: it has another word for what was done."""
    (part,) = plan.hosts
    older = {name: text.replace("'done before'", "'done earlier'") for name, text in shipped_module().items()}
    new = module_digest(older[MODULE_FILES[1]])
    scripts = {name: text.replace(module_digests()[MODULE_FILES[1]], new) for name, text in part.scripts.items()}
    files = {f"{MODULE_FOLDER}/{name}": text.encode("ascii") for name, text in older.items()}
    return replace(plan, hosts=(replace(part, scripts=scripts),)), files


def test_killed_run_is_finished_by_its_own_module() -> None:
    prepared = everything()
    plan, module = of_an_older_module(prepared.plan)
    undo = next(name for name in scripts_of(plan) if ".undo." in name and ".guest." not in name)
    files = {**scripts_of(plan), **module}
    files[undo] = scripts_of(prepared.plan)[undo]  # its digest is that of the undo of this version
    host = prepared.copy(kill_after=30)
    put(host, files)
    assert run(host, apply_script(plan)).code is None
    host = host.copy()
    for path in [path for path in host.files if path.startswith(FOLDER.lower())]:
        del host.files[path]
    undisturbed = prepared.copy()
    apply(undisturbed, prepared.plan)
    heard: list[str] = []

    class Reporter(RunReporter):
        def step_ended(self, host: str, number: int, total: int, step: object, status: object) -> None:
            heard.append(getattr(step, "title", ""))

    live = LiveHypervHost(a_host("onboard"), FakePowerShellTransport(host))
    done = finish_unfinished([live], RunControl(reporter=Reporter()))

    assert done is not None
    assert (done.ending, done.findings) == (RunEnding.DONE, ())
    assert "done earlier" in heard
    assert "done before" not in heard
    assert seen(host) == seen(undisturbed)
    assert host.file(f"{FOLDER}\\Rarms\\Rarms.psm1").data == module[MODULE]  # type: ignore[union-attr]


def test_journal_keeps_module_unless_script_holds_it() -> None:
    prepared = fresh()
    for plan, kept in ((prepared.plan, dict(shipped_module())), (in_one_file(prepared.plan), {})):
        host = prepared.copy()
        assert apply(host, plan).code == 0
        run_kept = LiveHypervHost(a_host("onboard"), FakePowerShellTransport(host)).journal()
        assert run_kept is not None
        assert run_kept.started.module == kept


def test_script_without_its_folder_says_where_it_belongs() -> None:
    prepared = fresh()
    host = prepared.copy()
    put(host, scripts_of(prepared.plan))

    ran = run(host, apply_script(prepared.plan))
    put(host, with_module({}))

    assert (ran.code, "Rarms\\Rarms.psd1" in ran.says) == (1, True), ran.says
    assert run(host, apply_script(prepared.plan)).code == 0


@pytest.mark.parametrize(
    ("change", "says"),
    [
        (without(MODULE), "Rarms.psm1 is missing: copy the folder Rarms next to this script"),
        (
            changed(MODULE, lambda data: data.replace(b"\r\n", b"\n")),
            "Rarms.psm1 has changed line ends",
        ),
        (changed(MODULE, lambda data: data + b"#"), "Rarms.psm1 is not from rarms"),
    ],
    ids=["missing", "line ends", "edited"],
)
def test_why_module_is_refused_is_said(change: Callable[[Mapping[str, bytes]], Mapping[str, bytes]], says: str) -> None:
    prepared = fresh()
    host = prepared.copy()
    put(host, change(files_of(prepared.plan)))

    assert says in run(host, apply_script(prepared.plan)).says
