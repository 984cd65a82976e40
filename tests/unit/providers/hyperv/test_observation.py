"""What observe.ps1 prints is read strictly, in any encoding that a PowerShell writes."""

import json
from typing import Any

import pytest

from rarms_iac.providers.hyperv.observation import HostObservation, Unread, is_observation, or_else
from rarms_iac.storage.codec import NotDecodable
from tests.recorded_hosts import NAMES, document, read_observation, recorded, recorded_bytes


@pytest.mark.parametrize("name", NAMES)
def test_every_recorded_answer_is_read(name: str) -> None:
    seen = recorded(name)

    assert seen.computer
    assert is_observation(document(name))


def test_redirected_by_windows_powershell_it_says_the_same() -> None:
    redirected = recorded_bytes("redirected-by-windows-powershell")

    assert redirected.startswith(b"\xff\xfe{\0")
    assert read_observation(redirected) == recorded("empty-host")


@pytest.mark.parametrize("encoding", ["utf-8", "utf-8-sig", "utf-16", "utf-16-le", "utf-16-be"])
def test_no_encoding_that_a_powershell_writes_is_lost(encoding: str) -> None:
    text = json.dumps(document("client-with-root-scheduler"))

    assert read_observation(text.encode(encoding)) == recorded("client-with-root-scheduler")


@pytest.mark.parametrize("encoding", ["utf-8", "utf-8-sig", "utf-16"])
def test_what_profile_says_around_document_is_skipped(encoding: str) -> None:
    line = json.dumps(document("client-with-root-scheduler"), separators=(",", ":"))
    noisy = f"Welcome, administrator\r\n{line}\r\nWARNING: {{ goodbye\r\n"

    assert read_observation(noisy.encode(encoding)) == recorded("client-with-root-scheduler")


def test_a_probe_is_a_value_absent_or_denied() -> None:
    seen = recorded("unprivileged-caller")

    assert seen.machines == ()
    assert isinstance(seen.hypervisor, Unread)
    assert seen.hypervisor.status == "denied"
    assert isinstance(seen.records, Unread)
    assert seen.records.status == "absent"
    assert or_else(seen.records, ()) == ()


def test_an_older_script_did_not_look() -> None:
    answer = document("empty-host")
    del answer["execution_policy"]

    seen = read_observation(json.dumps(answer).encode())

    assert isinstance(seen.execution_policy, Unread)
    assert seen.execution_policy.error == "NotLookedFor"


def changed(path: str, value: Any) -> bytes:
    """The server's answer with one value in another place; None takes it away."""
    answer = document("server-2022-with-strangers")
    at: Any = answer
    *way, last = path.split("/")
    for word in way:
        at = at[int(word) if word.isdigit() else word]
    if value is None:
        del at[last]
    else:
        at[last] = value
    return json.dumps(answer).encode()


@pytest.mark.parametrize(
    ("path", "value", "where"),
    [
        ("format", "rarms-observation/2", "format"),
        ("computer", 7, "the document"),
        ("bitlocker", {"status": "value", "value": 1}, "bitlocker"),
        ("elevated", True, "elevated"),
        ("elevated", {"status": "perhaps"}, "elevated.status"),
        ("elevated", {"status": "value", "value": 1}, "elevated.value"),
        ("elevated", {"status": "value"}, "elevated.status"),
        ("machines", {"status": "value", "value": {}}, "machines.value"),
        ("machines/value/0/reserve", "10", "machines.value[0].reserve"),
        ("machines/value/0/reserve", None, "machines.value[0].reserve"),
        ("machines/value/0/colour", "red", "machines.value[0].colour"),
        ("machines/value/1/id", "1c7f29d8-5a10-4f6e-9a57-7f6d0c2b8e11", "machines.value"),
        ("journal", {"status": "denied"}, "journal.error"),
    ],
)
def test_foreign_output_is_refused_with_place(path: str, value: Any, where: str) -> None:
    with pytest.raises(NotDecodable) as refused:
        read_observation(changed(path, value))

    assert str(refused.value).startswith(f"{where}: ")


@pytest.mark.parametrize("data", [b"", b"\xff\xfe\0", b"\xff", b"[]", b"{}", b"powershell is not recognized", b"{" * 9])
def test_what_is_no_observation_is_refused(data: bytes) -> None:
    with pytest.raises(NotDecodable):
        read_observation(data)


def test_every_probe_is_read() -> None:
    from rarms_iac.powershell.templates import template_text

    text = template_text("observe.ps1").split("$document = ")[1]
    probes = {
        line.split(" = ")[0].strip()
        for line in text.splitlines()
        if line.startswith("    ") and line[4] != " " and " = Get-Probe" in line
    }

    assert probes == set(HostObservation.__dataclass_fields__) - {"computer", "script_running"}
