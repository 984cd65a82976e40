"""What the model answers around Hyper-V: CIM, the event log, policies."""

from __future__ import annotations

from collections.abc import Callable

from rarms_iac.model.setting import LOAD_PARTITIONS
from tests.fake_powershell.host import Vm, WindowsHost
from tests.fake_powershell.hyperv import Caller, Given, refused
from tests.fake_powershell.values import Enumerated, Record, ScriptError, Unsupported, Value, text

HYPERVISOR = "Microsoft-Windows-Hyper-V-Hypervisor"


def get_win_event(caller: Caller, given: Given) -> list[Value]:
    wanted = {text(name): value for name, value in given["filterhashtable"].items()}
    if wanted.get("ProviderName") != HYPERVISOR or wanted.get("ID") != 2:
        raise Unsupported("another event than the scheduler's")
    data = caller.host.scheduler
    if data is None:
        raise ScriptError(
            "No events were found that match the specified selection criteria.",
            error_id="NoMatchingEventsFound,Microsoft.PowerShell.Commands.GetWinEventCommand",
            category="ObjectNotFound",
        )
    return [Record(Id=2, Properties=[Record(Value=data)])]


def get_cim_instance(caller: Caller, given: Given) -> list[Value]:
    host, name = caller.host, text(given["classname"])
    refused(caller.host, f"Get-CimInstance {name}")
    match name:
        case "Msvm_ComputerSystem":
            own = [Record(Name=host.computer)] if host.host_visible else []
            return own + [Record(Name=vm.id.upper()) for vm in host.vms.values()]
        case "Win32_ComputerSystem":
            return [Record(HypervisorPresent=host.hypervisor_running)]
        case "Win32_PerfFormattedData_HvStats_HyperVHypervisorLogicalProcessor":
            return [Record(Name="_Total")] if host.counters else []
        case "Win32_Processor":
            names = ("NumberOfCores", "NumberOfLogicalProcessors")
            return [
                Record(
                    Name=processor["name"], **dict(zip(names, (processor["cores"], processor["logical"]), strict=True))
                )
                for processor in host.processors
            ]
        case "Msvm_ProcessorSettingData":
            return [
                Record(InstanceID=group["instance"], CpuGroupId=group["group"], Reservation=group["reservation"])
                for group in host.cpu_groups
            ]
        case "Msvm_KvpExchangeComponent":
            return [
                Record(SystemName=vm.id.upper(), GuestIntrinsicExchangeItems=_told(vm.guest_build * vm.tells_build))
                for vm in host.vms.values()
                if vm.state == "Running"
            ]
        case "Msvm_ShutdownComponent":
            return [
                Record(SystemName=vm.id.upper(), EnabledState=2, OperationalStatus=[2 if vm.shutdown_service else 12])
                for vm in host.vms.values()
                if vm.state == "Running"
            ]
        case _ if name.startswith(COUNTERS):
            return counters(host, name.removeprefix(COUNTERS))
        case _:
            raise Unsupported(f"the class {name}")


def _told(build: int) -> list[Value]:
    """What a guest tells its host of itself."""
    if not build:
        return []
    pairs = {"FullyQualifiedDomainName": "robot", "OSName": "Windows Server 2025", "OSBuildNumber": str(build)}
    return [
        f'<INSTANCE CLASSNAME="Msvm_KvpExchangeDataItem"><PROPERTY NAME="Caption" TYPE="string"></PROPERTY>'
        f'<PROPERTY NAME="Data" TYPE="string"><VALUE>{data}</VALUE></PROPERTY>'
        f'<PROPERTY NAME="Name" TYPE="string"><VALUE>{name}</VALUE></PROPERTY></INSTANCE>'
        for name, data in pairs.items()
    ]


def get_execution_policy(caller: Caller, given: Given) -> list[Value]:
    return [
        Record(Scope=Enumerated(where), ExecutionPolicy=Enumerated(policy))
        for where, policy in caller.host.execution_policy
    ]


COUNTERS = "Win32_PerfRawData_HvStats_HyperVHypervisor"
"""How the classes of the hypervisor's counter sets begin."""


def counters(host: WindowsHost, counter_set: str) -> list[Value]:
    """What the hypervisor counted until now, by processor, and of all together as Windows adds it.

    P2's load never sleeps, and no limit holds it back: beside P1's one busy processor its parts get all that is left.
    """
    running = [vm for vm in host.vms.values() if vm.state == "Running"]
    for vm in running:
        passed = host.clock - max(vm.counted_at, vm.started_at or 0)
        vm.counted_at = host.clock
        busy = _busy(host, vm) if any(process.alive for process in host.processes) else 0.0
        vm.ran += int(passed * busy * 10_000)
        vm.dispatches += passed
        vm.waited += int(passed * (100 - vm.reserve) * 1000)
    root = host.clock * 100  # a hundredth of each processor
    match counter_set:
        case "LogicalProcessor":
            guests = sum(vm.ran * _processors(vm) for vm in running) // host.logical_processors
            found = [_run_times(f"Hv LP {number}", guests + root) for number in range(host.logical_processors)]
        case "RootVirtualProcessor":
            found = [_run_times(f"Root VP {number}", root) for number in range(host.logical_processors)]
        case "VirtualProcessor":
            found = [
                _run_times(
                    f"{vm.name}:Hv VP {number}",
                    vm.ran,
                    CPUWaitTimePerDispatch=vm.waited,
                    CPUWaitTimePerDispatch_Base=vm.dispatches,
                )
                for vm in running
                for number in range(_processors(vm))
            ]
        case _:
            raise Unsupported(f"the counter set {counter_set}")
    return [*found, _run_times("_Total", 0)]


def _busy(host: WindowsHost, vm: Vm) -> float:
    """The part of each of its processors' time that a machine uses, where programs run."""
    if vm.name not in LOAD_PARTITIONS:
        return vm.reserve / 100
    running = [each for each in host.vms.values() if each.state == "Running"]
    others = [each for each in running if each.name not in LOAD_PARTITIONS]
    rest = 0.99 * host.logical_processors - sum(_processors(other) * other.reserve / 100 for other in others)
    return min(1.0, rest / sum(_processors(each) for each in running if each.name in LOAD_PARTITIONS))


def _processors(vm: Vm) -> int:
    return 1 if vm.name.endswith("p1") else vm.processors


def _run_times(instance: str, ran: int, **waits: Value) -> Value:
    hypervisor = ran // 20
    return Record(
        Name=instance,
        PercentTotalRunTime=ran,
        PercentGuestRunTime=ran - hypervisor,
        PercentHypervisorRunTime=hypervisor,
        **waits,
    )


CMDLETS: dict[str, Callable[[Caller, Given], Value]] = {
    "get-winevent": get_win_event,
    "get-ciminstance": get_cim_instance,
    "get-executionpolicy": get_execution_policy,
}
