"""This computer's Windows: the real wmi module, the real registry, pywin32. Under wine, which has no Hyper-V."""

import json
import subprocess
import sys
import time
from collections.abc import Iterator
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import pytest

from rarms_iac.model.state import ValueKind
from rarms_iac.planner.task_classes import classes_of, registry_values
from rarms_iac.providers.hyperv.observation import observation_of
from rarms_iac.providers.hyperv.parse import to_state
from rarms_iac.providers.hyperv.wmi_document import PROFILE_KEY, NotRead, local_document
from tests.builders import a_component
from tests.planning import PLACES
from tests.unit.cli.running import rarms

if sys.platform != "win32":
    pytest.skip("needs windows: this is not Windows", allow_module_level=True)
assert sys.platform == "win32"

import winreg  # noqa: E402

import win32con  # noqa: E402
import win32file  # noqa: E402

from rarms_iac.providers.hyperv import local_windows  # noqa: E402
from rarms_iac.providers.hyperv.local_windows import ThisWindows, credential_files, observe_here  # noqa: E402

TASKS = rf"{PROFILE_KEY}\Tasks"
SHIPPED = {"Scheduling Category": "Medium", "SFIO Priority": "Normal", "Background Only": "True"}

MANIFEST = """\
schema: rarms/v1
application: { name: cell }
hosts:
  cell: { provider: hyperv, logical_processors: 2, memory: 4 GiB, keep_for_host: { processor: 5 %, memory: 1 GiB } }
components:
  vision: { criticality: 30, memory: 512 MiB, cpu: { reserve: 20 % } }
"""


@pytest.fixture
def tasks() -> Iterator[None]:
    """The real key of multimedia tasks with a class that Windows ships; wine has none."""
    _remove(TASKS)
    audio: Any = winreg.CreateKey(winreg.HKEY_LOCAL_MACHINE, rf"{TASKS}\Audio")
    for name, text in SHIPPED.items():
        winreg.SetValueEx(audio, name, 0, winreg.REG_SZ, text)
    winreg.SetValueEx(audio, "Affinity", 0, winreg.REG_DWORD, 0xFFFFFFFF)
    winreg.CloseKey(audio)
    yield
    _remove(TASKS)


def _remove(path: str) -> None:
    subprocess.run(["reg", "delete", rf"HKLM\{path}", "/f"], capture_output=True)


def test_windows_without_hyperv_is_read_otherwise() -> None:
    found = json.loads(observe_here())

    observation_of(found)
    for probe in ("host_visible", "hypervisor", "machines", "switches", "firmware", "guests"):
        assert (found[probe]["status"], found[probe]["error"]) == ("absent", "0x8004100e"), probe
        assert "the role Hyper-V is not installed" in found[probe]["message"]
    assert found["elevated"] == {"status": "value", "value": True}
    assert found["machine_id"]["status"] == "value"


def test_plan_and_doctor_name_missing_hyperv(tmp_path: Path) -> None:
    (tmp_path / "rarms.yaml").write_text(MANIFEST, encoding="utf-8")

    planned = rarms("plan", "-f", str(tmp_path))
    examined = rarms("doctor", "-f", str(tmp_path))

    assert planned.code == 1
    assert "the role Hyper-V is not installed" in " ".join(planned.err.split())
    assert examined.code == 2
    assert "RARMS233" in examined.out + examined.err
    assert "0x8004100e" in examined.out + examined.err


def test_registry_gives_task_classes(tasks: None, tmp_path: Path) -> None:
    """Through a real `reg import` and export; what Windows ships stays to the byte, and types are compared."""
    component = a_component("speech", criticality=9, task="SpeechRecognition")
    (values,) = classes_of([component], {}, "", PLACES).classes
    before = _exported(rf"{TASKS}\Audio", tmp_path)
    lines = ["Windows Registry Editor Version 5.00", "", rf"[HKEY_LOCAL_MACHINE\{TASKS}\SpeechRecognition]"]
    for name, value in registry_values(values).items():
        text = f"dword:{value.data:08x}" if value.kind is ValueKind.DWORD else f'"{value.data}"'
        lines.append(f'"{name}"={text}')
    (tmp_path / "class.reg").write_text("\n".join([*lines, ""]), encoding="utf-16")

    subprocess.run(["reg", "import", str(tmp_path / "class.reg")], check=True, capture_output=True)
    state = to_state(observation_of(local_document(ThisWindows())), "cell")

    classes = {task.name: task for task in state.tasks}
    assert dict(classes["SpeechRecognition"].values) == dict(registry_values(values))
    assert classes["Audio"].values["Affinity"].data == 0xFFFFFFFF
    assert _exported(rf"{TASKS}\Audio", tmp_path) == before
    exported = _exported(rf"{TASKS}\SpeechRecognition", tmp_path).decode("utf-16").splitlines()
    assert {line for line in lines if line} <= set(exported), "what was imported comes out again, types included"


def _exported(path: str, folder: Path) -> bytes:
    file = folder / "exported.reg"
    subprocess.run(["reg", "export", rf"HKLM\{path}", str(file), "/y"], check=True, capture_output=True)
    return file.read_bytes()


@pytest.mark.parametrize(
    ("kind", "data", "expected"),
    [
        ("REG_SZ", "True", ("String", "True")),
        ("REG_DWORD", 0xFFFFFFFF, ("DWord", 0xFFFFFFFF)),
        ("REG_QWORD", 2**63, ("QWord", 2**63)),
        ("REG_EXPAND_SZ", "%RARMS_TESTS%!", ("ExpandString", "here!")),
        ("REG_MULTI_SZ", ["a", "b"], ("MultiString", "a b")),
        ("REG_BINARY", b"\x01\xff", ("Binary", "1 255")),
    ],
)
def test_values_have_kinds_and_data_that_powershell_shows(
    kind: str, data: Any, expected: tuple[str, Any], tasks: None, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv("RARMS_TESTS", "here")
    with winreg.CreateKey(winreg.HKEY_LOCAL_MACHINE, rf"{TASKS}\Odd") as key:
        winreg.SetValueEx(key, "Value", 0, getattr(winreg, kind), data)

    assert ThisWindows().key(rf"{TASKS}\Odd").values == [("Value", *expected)]


def test_a_key_that_is_not_there_is_absent() -> None:
    with pytest.raises(NotRead) as raised:
        ThisWindows().key(r"SOFTWARE\rarms\nowhere")

    assert (raised.value.error, raised.value.denied) == ("PathNotFound", False)


def test_a_journal_comes_with_its_owner(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("PROGRAMDATA", str(tmp_path))
    (tmp_path / "rarms").mkdir()
    (tmp_path / "rarms" / "journal.jsonl").write_text("{}", encoding="ascii")

    owner, text = ThisWindows().journal()

    assert owner.startswith("S-1-5-")
    assert text == "{}"


def test_journal_is_read_while_run_replaces_it(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """The name is missing between the two renames by which Windows replaces a file."""
    monkeypatch.setenv("PROGRAMDATA", str(tmp_path))
    (tmp_path / "rarms").mkdir()
    journal, fresh = (tmp_path / "rarms" / f"journal.jsonl{end}" for end in ("", ".new"))
    fresh.write_text("{}", encoding="ascii")
    monkeypatch.setattr(time, "sleep", lambda _: fresh.rename(journal))

    assert ThisWindows().journal()[1] == "{}"


def test_journal_that_never_began_is_absent(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("PROGRAMDATA", str(tmp_path))
    (tmp_path / "rarms").mkdir()
    (tmp_path / "rarms" / "journal.jsonl.new").write_text("{", encoding="ascii")
    looks: list[float] = []
    monkeypatch.setattr(time, "sleep", looks.append)

    with pytest.raises(NotRead) as raised:
        ThisWindows().journal()

    assert (raised.value.error, sum(looks) < 2) == ("PathNotFound", True)


def test_held_journal_is_not_called_denied(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(local_windows, "own_folder", lambda: tmp_path)
    monkeypatch.setattr(time, "sleep", lambda _: None)
    path = str(tmp_path / "journal.jsonl")
    alone = win32file.CreateFile(path, win32con.GENERIC_WRITE, 0, None, win32con.CREATE_NEW, 0, None)

    with pytest.raises(NotRead) as raised:
        ThisWindows().journal()
    alone.Close()

    assert (raised.value.error, raised.value.denied) == ("Win32Error32", False)


DISK = """<INSTANCE CLASSNAME="Msvm_VirtualHardDiskSettingData"><PROPERTY NAME="Type" TYPE="uint16"><VALUE>4</VALUE>
</PROPERTY><PROPERTY NAME="ParentPath" TYPE="string"><VALUE>D:\\images\\base.vhdx</VALUE></PROPERTY></INSTANCE>"""


class Properties(list[Any]):
    """The properties of a COM object: a list, and asked by name."""

    def __call__(self, name: str) -> Any:
        return next(each for each in self if each.Name == name)


def made(**values: Any) -> Any:
    """An instance as COM gives it, within the real module's own object; a path is a reference of an association."""
    properties = Properties()
    for name, value in values.items():
        kind = "ref:CIM_ManagedElement" if str(value).startswith("\\\\") else "string"
        qualifiers = [SimpleNamespace(Name="CIMTYPE", Value=kind)]
        properties.append(SimpleNamespace(Name=name, Value=value, Qualifiers_=qualifiers))
    path = SimpleNamespace(DisplayName="an instance")
    return local_windows.wmi._wmi_object(
        SimpleNamespace(Path_=path, Properties_=properties, Methods_=(), Qualifiers_=())
    )


ENDS = {
    "ManagedElement": '\\\\CELL\\root:Msvm_ComputerSystem.Name="A"',
    "SettingData": '\\\\CELL\\root:S.InstanceID="B"',
}


def test_named_values_are_taken_once_a_class(monkeypatch: pytest.MonkeyPatch) -> None:
    """A connection of ours, as wine has no provider: an older host lacks properties, and references stay paths."""
    asked: list[str] = []

    class Connection:
        def query(self, text: str) -> list[Any]:
            asked.append(text)
            service = SimpleNamespace(GetVirtualHardDiskSettingData=lambda Path: (None, 0, DISK))  # noqa: N803
            if "ImageManagement" in text:
                return [service]
            return [made(**ENDS)] if "DefineState" in text else [made(Name="cell", ElementName="id")]

    monkeypatch.setattr(local_windows.wmi, "WMI", lambda **_: Connection())
    windows = ThisWindows()

    for _ in range(2):
        assert windows.instances("Msvm_VirtualEthernetSwitch") == [{"Name": "cell", "ElementName": "id"}]
    assert windows.instances("Msvm_NumaNode")[0]["NumberOfLogicalProcessors"] is None
    assert windows.instances("Msvm_SettingsDefineState") == [ENDS]
    assert windows.disk("D:\\a.vhdx") == {"Type": "4", "ParentPath": "D:\\images\\base.vhdx"}
    assert asked.count("SELECT * FROM Msvm_VirtualEthernetSwitch") == 1


def refusal(code: int, *, listing: bool) -> Exception:
    """What the module raises where there is no connection, and while the instances of a query are listed."""
    if listing:
        told = (0, "SWbemObjectSet", "Invalid class", None, 0, code - 2**32)
        return local_windows.pywintypes.com_error(-2147352567, "Exception occurred.", told, None)
    error = local_windows.pywintypes.com_error(code - 2**32, "OLE error", None, None)
    return local_windows.wmi.x_wmi("", com_error=error)


@pytest.mark.parametrize("listing", [True, False])
@pytest.mark.parametrize(("code", "denied"), [(0x80041003, True), (0x80041010, False)])
def test_wmi_refusal_is_denied_and_unknown_absent(
    code: int, denied: bool, listing: bool, monkeypatch: pytest.MonkeyPatch
) -> None:
    def refuse(**_: object) -> None:
        raise refusal(code, listing=listing)

    monkeypatch.setattr(local_windows.wmi, "WMI", refuse)

    with pytest.raises(NotRead) as raised:
        ThisWindows().instances("Msvm_ComputerSystem")

    assert (raised.value.error, raised.value.denied) == (f"0x{code:08x}", denied)


@pytest.mark.parametrize("killed", [False, True])
def test_running_script_is_not_disturbed(killed: bool, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """A process of its own has the file open as lock.ps1 does; when it is gone, so is what it held."""
    monkeypatch.setattr(local_windows, "own_folder", lambda: tmp_path)
    assert not ThisWindows().is_script_running(), "no file is there"
    holder = (
        "import sys, win32con, win32file; file = win32file.CreateFile(sys.argv[1], win32con.GENERIC_WRITE, "
        "win32con.FILE_SHARE_READ, None, win32con.OPEN_ALWAYS, 0, None); print('held', flush=True); sys.stdin.read()"
    )
    words = [sys.executable, "-c", holder, str(tmp_path / local_windows.OWNER)]

    with subprocess.Popen(words, stdin=subprocess.PIPE, stdout=subprocess.PIPE) as script:
        assert script.stdout is not None
        assert script.stdout.readline().strip() == b"held"
        seen = [ThisWindows().is_script_running() for _ in range(2)]
        if killed:
            script.kill()
        script.communicate()

    assert seen == [True, True]
    assert not ThisWindows().is_script_running()


def test_membership_of_hyperv_administrators_is_asked_of_token() -> None:
    """wine's account is an administrator, and wine knows no such group."""
    assert (ThisWindows().is_elevated(), ThisWindows().is_hyperv_administrator()) == (True, False)


NAME = "rarms-tests/torch-motion"


@pytest.fixture
def stored(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Iterator[Path]:
    """A generic credential in the real Credential Manager; the file that scripts look for, not yet there."""
    win32cred = local_windows.win32cred
    monkeypatch.setenv("PROGRAMDATA", str(tmp_path))
    told = {"Type": win32cred.CRED_TYPE_GENERIC, "TargetName": NAME, "UserName": "operator"}
    win32cred.CredWrite({**told, "CredentialBlob": "s\u00e4ge 7", "Persist": win32cred.CRED_PERSIST_LOCAL_MACHINE}, 0)
    yield tmp_path / "rarms" / "credentials" / "rarms-tests_torch-motion.txt"
    win32cred.CredDelete(NAME, win32cred.CRED_TYPE_GENERIC)


def test_credential_is_found_only_while_scripts_run(stored: Path) -> None:
    """Wine keeps the owner that Linux knows: that the file belongs to Administrators is not seen here."""
    with credential_files([NAME, "rarms-tests/nobody"]):
        user, secret = stored.read_text(encoding="utf-8").splitlines()
        names = [path.name for path in stored.parent.iterdir()]

    _, plain = local_windows.win32crypt.CryptUnprotectData(bytes.fromhex(secret), None, None, None, 0)
    assert (user, plain.decode("utf-16-le")) == ("operator", "s\u00e4ge 7")
    assert names == [stored.name]
    assert not stored.exists()


def test_credential_file_of_operator_counts_and_stays(stored: Path) -> None:
    stored.parent.mkdir(parents=True)
    stored.write_text("somebody\nelse\n", encoding="utf-8")

    with credential_files([NAME]):
        found = stored.read_text(encoding="utf-8")

    assert found == stored.read_text(encoding="utf-8") == "somebody\nelse\n"
