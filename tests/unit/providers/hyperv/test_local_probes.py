"""A host through WMI and the registry is the host that observe.ps1 shows: one set of fixtures, read both ways."""

import json
from collections.abc import Sequence
from typing import Any

import pytest

from rarms_iac.providers.hyperv.observation import observation_of
from rarms_iac.providers.hyperv.parse import identity_of, to_state
from rarms_iac.providers.hyperv.wmi_document import QUERIES, STATES, NotRead, WmiInstance, local_document
from tests.cases.situations import folders
from tests.fake_powershell.observing import document_of, host_from
from tests.recorded_hosts import NAMES, document
from tests.unit.providers.hyperv.made_windows import FACTS, MadeWindows

NOT_IN_WMI = ("powershell", "execution_policy")
"""Which PowerShell looked, and what its process allows: no state depends on them."""


def printed(name: str) -> dict[str, Any]:
    """What observe.ps1 prints of a host, without machines in states that WMI's pages do not number."""
    found = document_of(host_from(document(name)))
    if found["machines"]["status"] == "value":
        known = [machine for machine in found["machines"]["value"] if _is_numbered(machine["state"])]
        gone = {machine["id"] for machine in found["machines"]["value"]} - {machine["id"] for machine in known}
        found["machines"]["value"] = known
        for probe in ("firmware", "guests", "shutdown_services"):
            found[probe]["value"] = [each for each in found[probe]["value"] if each["machine"] not in gone]
        disks = {disk for machine in known for disk in machine["disks"]}
        found["virtual_disks"]["value"] = [each for each in found["virtual_disks"]["value"] if each["path"] in disks]
        groups = found["cpu_groups"]
        if groups["status"] == "value":
            groups["value"] = [each for each in groups["value"] if each["instance"][10:46].lower() not in gone]
    return with_own_id(found, document(name))


def with_own_id(found: dict[str, Any], recorded: dict[str, Any]) -> dict[str, Any]:
    """With the Windows' own id in the place of the host's identity, which is made of it."""
    return {**found, "machine_id": recorded["machine_id"]}


def _is_numbered(state: str) -> bool:
    return state.removesuffix("Critical") in STATES.values()


@pytest.mark.parametrize("name", NAMES)
def test_both_ways_show_the_same_state(name: str) -> None:
    by_script = printed(name)

    by_wmi = local_document(MadeWindows(by_script))

    assert to_state(observation_of(by_wmi), "cell") == to_state(observation_of(by_script), "cell")


@pytest.mark.parametrize("name", NAMES)
def test_both_ways_print_the_same_field_by_field(name: str) -> None:
    by_script = printed(name)

    by_wmi: dict[str, Any] = local_document(MadeWindows(by_script))

    assert by_wmi.keys() - by_script.keys() == {"script_running"}
    assert by_script.keys() - by_wmi.keys() == set()
    for machine in by_script["machines"].get("value", []):
        machine.setdefault("replication_mode", "None")  # which the script of the recording did not ask
    for node in by_script["numa"].get("value", []):
        node["memory"] = 0  # no page names a node's total
    groups = by_wmi["cpu_groups"]
    if "value" in groups:  # some of the recorded hosts show no setting of a machine's processors
        groups["value"] = [each for each in groups["value"] if "\\cpu\\" not in each["instance"]]
    for probe in by_script.keys() - set(NOT_IN_WMI):
        expected, found = by_script[probe], by_wmi[probe]
        if probe == "machine_id" and "value" in expected:
            expected = {**expected, "value": identity_of(expected["value"])}
        if isinstance(expected, dict) and expected["status"] != "value":
            assert found["status"] in (expected["status"], "denied"), probe
        else:
            assert found == expected, probe


@pytest.mark.parametrize("folder", [folder for folder in folders() if "boot" in folder.name or "live" in folder.name])
def test_secure_boot_and_what_guests_tell_come_through(folder: Any) -> None:
    recorded = json.loads((folder / "host.json").read_text(encoding="utf-8"))
    by_script = with_own_id(document_of(host_from(recorded)), recorded)

    by_wmi = local_document(MadeWindows(by_script))

    assert by_wmi["firmware"] == by_script["firmware"]
    assert by_wmi["guests"] == by_script["guests"]
    assert to_state(observation_of(by_wmi), "cell") == to_state(observation_of(by_script), "cell")


def test_unnamed_state_hides_no_other_machine() -> None:
    class Odd(MadeWindows):
        def instances(self, name: str) -> Sequence[WmiInstance]:
            found = [dict(each) for each in super().instances(name)]
            if name == "Msvm_ComputerSystem":
                found[1]["EnabledState"] = 32790
            return found

    by_script = printed("server-2022-with-strangers")

    found = observation_of(local_document(Odd(by_script)))

    state = to_state(found, "cell")
    assert len(state.partitions) == len(by_script["machines"]["value"]) - 1
    unread = local_document(Odd(by_script))["unread_machines"]
    assert isinstance(unread, dict)
    assert "EnabledState is 32790" in str(unread["value"])


@pytest.mark.parametrize("denied", [True, False])
def test_unreadable_class_is_no_empty_list(denied: bool) -> None:
    class Refusing(MadeWindows):
        def instances(self, name: str) -> Any:
            if name == "Msvm_SettingsDefineState":
                raise NotRead("0x80041003", "no", denied=denied)
            return super().instances(name)

    found = local_document(Refusing(printed("server-2022-with-strangers")))

    assert found["machines"] == {"status": "denied" if denied else "absent", "error": "0x80041003", "message": "no"}


def test_asked_properties_belong_to_their_class() -> None:
    assert {name for name in QUERIES if name.startswith("Msvm_")} - FACTS.keys() == set()
    assert {name: sorted(FACTS[name]) for name in FACTS} == {name: sorted(QUERIES[name]) for name in FACTS}
