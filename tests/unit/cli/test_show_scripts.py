"""`rarms show --script`: numbered, coloured, raw, written, compared and checked."""

import json
import re
import subprocess
import sys
from dataclasses import replace
from pathlib import Path

import pytest

from rarms_iac.app.plan_files import read_plan_file
from rarms_iac.app.scripts import ScriptSelection, plan_scripts, scripts_to_write
from rarms_iac.app.use_case_errors import UseCaseError
from rarms_iac.model.version import __version__
from rarms_iac.storage.shipped import shipped
from rarms_iac.views.scripts import script_text
from tests.fake_powershell.signing import signed
from tests.unit.cli.running import rarms

CELL = shipped("manifests/hyperv-cell")


@pytest.fixture(scope="module")
def plan(tmp_path_factory: pytest.TempPathFactory) -> str:
    """The plan of the example."""
    path = str(tmp_path_factory.mktemp("cell") / "cell.plan")
    assert rarms("plan", "-f", str(CELL), "--snapshot", f"cell={CELL / 'host.json'}", "--out", path).code == 0
    return path


@pytest.fixture(scope="module")
def folder(plan: str, tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Its scripts, written out."""
    path = tmp_path_factory.mktemp("scripts")
    assert rarms("show", "--script", plan, "--out", str(path)).code == 0
    return path


@pytest.fixture(scope="module")
def single(plan: str, tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Its scripts, each as one file."""
    path = tmp_path_factory.mktemp("single")
    assert rarms("show", "--script", plan, "--single-file", "--out", str(path)).code == 0
    return path


@pytest.mark.parametrize("form", ["module", "single"])
def test_line_numbers_are_those_of_the_file(
    plan: str, folder: Path, single: Path, form: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    more = ("--single-file",) if form == "single" else ()
    words = ("show", "--script", plan, "--guest", "", "--host", "cell", *more)
    piped = rarms(*words).out
    monkeypatch.setenv("COLUMNS", "80")
    monkeypatch.setenv("NO_COLOR", "1")
    written = (single if form == "single" else folder) / "cell.ps1"
    lines = written.read_bytes().decode("ascii").split("\r\n")

    assert rarms(*words).out == piped  # COLUMNS sets a width and nothing else
    shown = rarms("show", "--script", plan, *more, shown_at_a_terminal=True).out

    numbered = re.findall(r"^ *([0-9]+)(?:  (.*))?$", shown, re.MULTILINE)
    assert all(lines[int(number) - 1].rstrip() == text for number, text in numbered)
    assert (": the module of rarms, shown only in a pipe" in shown) is (form == "single")
    assert "function " not in shown
    assert ("function Lock-Host" in piped) is (form == "single")
    assert "'torch-motion.rarms-" in shown


def test_provisional_scripts_are_written_after_consent(plan: str) -> None:
    made = read_plan_file(plan)
    (part,) = made.hosts
    provisional = replace(made, hosts=(replace(part, provisional=(part.steps[-1].address.partition,)),))
    accepted = replace(provisional, inputs=replace(made.inputs, accept_provisional=True))
    scripts = plan_scripts(made)

    with pytest.raises(UseCaseError) as refused:
        scripts_to_write(provisional, scripts, scripts, ScriptSelection())
    assert [finding.code for finding in refused.value.findings] == ["RARMS109"]
    assert scripts_to_write(accepted, scripts, scripts, ScriptSelection()) == scripts


def test_module_lies_beside_scripts_that_need_it(plan: str, folder: Path, single: Path) -> None:
    files = {path.name: path for path in (folder / "Rarms").iterdir()}
    assert sorted(files) == ["Rarms.psd1", "Rarms.psm1", "observe.ps1"]
    assert not (single / "Rarms").exists()
    for name in ("Rarms.psm1", "observe.ps1"):
        data = files[name].read_bytes()
        for there, kept in ((signed(data), signed(data)), (data + b"# more\r\n", data)):
            files[name].write_bytes(there)
            assert rarms("show", "--script", plan, "--out", str(folder)).code == 0
            assert files[name].read_bytes() == kept


def test_pipe_gets_the_written_bytes(plan: str, folder: Path) -> None:
    loaded = {load["name"]: load for load in json.loads(rarms("show", "--script", plan, "--json").out)["scripts"]}

    assert loaded["cell.ps1"]["text"].encode("ascii") == (folder / "cell.ps1").read_bytes()
    raw = rarms("show", "--script", plan, "--guest", "torch-motion", "--undo").out
    written = (folder / "cell.guest.torch-motion.undo.ps1").read_bytes().decode("ascii")
    assert raw.replace("\r\n", "\n") == written.replace("\r\n", "\n")
    assert len(list(folder.glob("*.ps1"))) == 6
    assert (folder / ".gitattributes").read_text(encoding="ascii") == "*.ps1 -text\n*.psd1 -text\n*.psm1 -text\n"


def test_without_a_plan_it_is_made_first(folder: Path) -> None:
    ran = rarms("show", "--script", "-f", str(CELL), "--snapshot", f"cell={CELL / 'host.json'}", "--json")

    (script,) = json.loads(ran.out)["scripts"]
    assert script["text"].encode("ascii") == (folder / "cell.ps1").read_bytes()
    assert "seam-tracking, torch-motion (--guest NAME)" in ran.err


def test_colour_changes_no_character() -> None:
    text = "<# a remark\nof two lines #>\n$vm = Get-Machine -Name 'it''s'\nif ($true) { Hyper-V\\Start-VM -VM $vm }\n"

    coloured = script_text(text, colour=True)

    assert re.sub("\x1b\\[[0-9;]*m", "", coloured) == script_text(text)
    assert all(line.count("\x1b[") % 2 == 0 and line.endswith("\x1b[0m") for line in coloured.splitlines()[:3])
    assert re.sub("\x1b\\[[0-9;]*m", "", script_text("'open", colour=True)) == "1  'open\n"


@pytest.fixture(scope="module")
def other(plan: str, tmp_path_factory: pytest.TempPathFactory) -> str:
    """The plan of the example with another reserve."""
    folder = tmp_path_factory.mktemp("other")
    text = (CELL / "rarms.yaml").read_text(encoding="utf-8")
    (folder / "rarms.yaml").write_text(
        text.replace("reserve: 2.8 LP", "reserve: 2.4 LP"), encoding="utf-8", newline="\n"
    )
    path = str(folder / "other.plan")
    assert rarms("plan", "-f", str(folder), "--snapshot", f"cell={CELL / 'host.json'}", "--out", path).code == 0
    return path


def test_two_plans_are_compared_by_steps(plan: str, other: str) -> None:
    compared = rarms("show", "--script", other, "--against", plan)
    same = rarms("show", "--script", plan, "--against", plan)
    loaded = json.loads(rarms("show", "--script", other, "--against", plan, "--json").out)

    assert compared.code == same.code == 0
    assert "  ~ partition/seam-tracking, step " in compared.out
    assert "      after.reserve  70 -> 60\n" in compared.out
    assert "0 new" in compared.out
    assert {step["address"] for step in loaded["steps"]} == {"partition/seam-tracking"}
    assert "all steps are equal" in same.out


def test_a_script_file_is_compared_line_by_line(plan: str, other: str, folder: Path, tmp_path: Path) -> None:
    (tmp_path / "signed.ps1").write_bytes(signed((folder / "cell.ps1").read_bytes()))

    compared = rarms("show", "--script", other, "--against", str(folder / "cell.ps1"))
    same = rarms("show", "--script", plan, "--against", str(tmp_path / "signed.ps1"))
    loaded = json.loads(rarms("show", "--script", other, "--against", str(folder / "cell.ps1"), "--json").out)

    assert compared.code == same.code == 0
    changed = [line for line in compared.out.splitlines() if "Reserve = " in line and line[0] != " "]
    assert {line[0] for line in changed} == {"-", "+"}
    assert loaded["kind"] == "script_text_difference"
    assert "all lines are equal" in same.out


@pytest.mark.parametrize(
    ("old", "new", "problem"),
    [
        (b"Reserve = 80", b"Reserve = 75", ""),
        (b"Reserve = 80", b"Reserve = \xc3\xa9", "the byte 0xc3 is not printable ASCII"),
        (b"$plan = {\r\n", b"$plan = {\n", "does not end with CR LF"),
        (b"$plan = {", b"$plan = ", "PowerShell's grammar"),
    ],
)
def test_an_edited_script_is_checked(folder: Path, tmp_path: Path, old: bytes, new: bytes, problem: str) -> None:
    good = (folder / "cell.ps1").read_bytes()
    (tmp_path / "edited.ps1").write_bytes(signed(good.replace(old, new)))

    checked = rarms("show", "--check", str(tmp_path / "edited.ps1"))

    assert (checked.code, "PowerShell can read" in checked.out) == ((2, False) if problem else (0, True))
    assert problem in checked.out


@pytest.mark.parametrize(
    ("words", "message"),
    [
        (("--script", "--host", "cel"), 'The plan does not have the host "cel". Did you mean'),
        (("--script", "--guest", "torch"), 'does not have a script for the guest "torch"'),
        (("--undo",), "needs --script"),
        (("--script", "--snapshot", "x.json"), "A PLAN cannot be combined with --snapshot"),
    ],
)
def test_what_cannot_be_meant_is_a_wrong_usage(plan: str, words: tuple[str, ...], message: str) -> None:
    ran = rarms("show", plan, *words)

    assert (ran.code, message in ran.err) == (64, True), ran.err


def test_what_travels_over_ssh_is_shown() -> None:
    shown = rarms("show", "--transport").out

    assert "-EncodedCommand carries" in shown
    assert "name length sha256" in shown
    assert "Receive-RarmsPlan" in shown


def test_module_is_written_as_it_lies_on_host(tmp_path: Path) -> None:
    assert rarms("show", "--transport", "--out", str(tmp_path)).code == 0

    written = {path.relative_to(tmp_path).as_posix() for path in tmp_path.rglob("*") if path.is_file()}
    version = tmp_path / "Rarms" / __version__
    module = {f"Rarms/{__version__}/{name}" for name in ("Rarms.psd1", "Rarms.psm1", "observe.ps1")}
    assert written == {"Rarms/receive.ps1", *module}
    assert f"ModuleVersion        = '{__version__}'" in (version / "Rarms.psd1").read_text(encoding="ascii")
    assert b"\r\n" in (tmp_path / "Rarms" / "receive.ps1").read_bytes()


def test_simulated_host_shows_what_hyperv_host_would_get(tmp_path: Path) -> None:
    assert rarms("init", str(tmp_path / "robot"), "--name", "robot").code == 0
    path = str(tmp_path / "plan")
    assert rarms("plan", "-f", str(tmp_path / "robot"), "--out", path).code == 0

    ran = rarms("show", "--script", path)

    assert ran.code == 0
    assert "Hyper-V\\New-VM" in ran.out


def test_script_in_pipe_is_shown_without_rich(plan: str) -> None:
    code = (
        "import sys\nfrom rarms_iac.cli.main import main\n"
        f"sys.argv = ['rarms', 'show', '--script', {plan!r}]\n"
        "try:\n    main()\nfinally:\n    print([name for name in sys.modules if name.partition('.')[0] == 'rich'])\n"
    )

    ran = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)

    assert ran.stdout.splitlines()[-1] == "[]"


def test_removed_machine_is_lost_in_the_script(tmp_path: Path) -> None:
    assert rarms("init", str(tmp_path)).code == 0
    assert rarms("apply", "--auto-approve", "-f", str(tmp_path)).code == 0
    path = str(tmp_path / "removal.plan")
    assert rarms("destroy", "-f", str(tmp_path), "--out", path).code == 0

    shown = rarms("show", "--script", path)

    assert shown.code == 0, shown.err
    assert "the partition cannot be created again" in shown.out
    assert "the partition cannot be created again" not in rarms("show", path).out, "the simulated host makes it again"
