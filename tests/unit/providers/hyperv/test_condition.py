import pytest

from rarms_iac.model.condition import HostCondition, MachineCondition, PolicyScope
from rarms_iac.providers.hyperv.condition import condition_of
from rarms_iac.providers.hyperv.observation import HostObservation
from rarms_iac.providers.hyperv.parse import to_state
from tests.recorded_hosts import NAMES, recorded, unread

STRANGERS = "server-2022-with-strangers"
GROUP = "36ab08cb-3a76-4b38-992e-000000000002"


@pytest.mark.parametrize("name", NAMES)
def test_every_recorded_host_has_a_condition(name: str) -> None:
    seen = recorded(name)

    assert condition_of(seen).powershell is not None


def machine(of: HostCondition, id_: str) -> MachineCondition:
    (found,) = [machine for machine in of.machines if machine.id == id_]
    return found


def an_id() -> str:
    return condition_of(recorded(STRANGERS)).machines[0].id


def cpu_group(seen: HostObservation) -> str:
    (found,) = [partition.cpu_group for partition in to_state(seen, "cell").partitions if partition.id == an_id()]
    return found


@pytest.mark.parametrize("group", [GROUP, GROUP.upper(), "{" + GROUP + "}"])
def test_group_of_machine_is_found_by_its_instance(group: str) -> None:
    setting = {"instance": f"Microsoft:{an_id().upper()}\\b637f346-6a0e-4dec-af52-bd70cb80a21d\\0", "group": group}
    seen = recorded(STRANGERS, cpu_groups=[{**setting, "reservation": 0}])

    assert cpu_group(seen) == GROUP


@pytest.mark.parametrize("group", ["", "00000000-0000-0000-0000-000000000000"])
def test_no_group_is_no_group(group: str) -> None:
    setting = {"instance": f"Microsoft:{an_id()}\\0", "group": group, "reservation": 0}

    assert cpu_group(recorded(STRANGERS, cpu_groups=[setting])) == ""


def test_policies_of_later_scopes_are_left_out() -> None:
    policies = [{"scope": "MachinePolicy", "policy": "AllSigned"}, {"scope": "Fleet", "policy": "Restricted"}]

    seen = recorded(STRANGERS, execution_policy=policies)

    assert condition_of(seen).policies == {PolicyScope.MACHINE_POLICY: "AllSigned"}


@pytest.mark.parametrize(("status", "message"), [("absent", "absent (Gone)"), ("denied", "denied (Gone)")])
def test_what_was_not_read_is_said_with_reason(status: str, message: str) -> None:
    found = condition_of(unread(STRANGERS, "cpu_groups", "numa", status=status))

    assert found.numa_nodes is None
    assert {name: found.unread[name] for name in ("the CPU groups", "the NUMA nodes")} == {
        "the CPU groups": message,
        "the NUMA nodes": message,
    }


def test_no_module_is_known_to_be_none() -> None:
    assert condition_of(recorded(STRANGERS, module=[])).module == ()
