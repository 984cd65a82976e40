"""A Windows as WMI and the registry show it, made from what observe.ps1 prints of a host. Made: none was asked."""

import json
from collections import defaultdict
from collections.abc import Mapping, Sequence
from typing import Any

from rarms_iac.providers.hyperv import wmi_document
from rarms_iac.providers.hyperv.wmi_document import QUERIES, NotRead, RegistryKey, WmiInstance
from tests.needs import CHECKOUT

FACTS: Mapping[str, Mapping[str, str]] = json.loads(
    (CHECKOUT / "tests" / "recorded" / "wmi" / "classes.json").read_text(encoding="utf-8")
)
MIB = 2**20
RESTS_ON = {
    "hypervisor": "Msvm_VirtualSystemManagementServiceSettingData",
    "numa": "Msvm_NumaNode",
    "switches": "Msvm_VirtualEthernetSwitch",
    "machines": "Msvm_ComputerSystem",
    "host_visible": "Msvm_ComputerSystem",
    "cpu_groups": "Msvm_ProcessorSettingData",
    "processors": "Win32_Processor",
    "counters": wmi_document.COUNTERS,
    "guests": "Msvm_KvpExchangeComponent",
    "shutdown_services": "Msvm_ShutdownComponent",
}
KEYS = {
    "profile": wmi_document.PROFILE_KEY,
    "tasks": rf"{wmi_document.PROFILE_KEY}\Tasks",
    "records": wmi_document.RECORDS_KEY,
    "windows": wmi_document.WINDOWS_KEY,
    "machine_id": wmi_document.CRYPTOGRAPHY_KEY,
    "powershell": wmi_document.ENGINE_KEY,
}


def reference(name: str, key: str, value: str) -> str:
    """The path of an instance, as references have it."""
    escaped = value.replace("\\", "\\\\")
    return f'\\\\CELL\\root\\virtualization\\v2:{name}.{key}="{escaped}"'


class MadeWindows:
    """A `LocalWindows`."""

    def __init__(self, document: Mapping[str, Any]) -> None:
        self._document = document
        self._instances: dict[str, list[WmiInstance]] = defaultdict(list)
        self._disks: dict[str, WmiInstance] = {}
        self._keys: dict[str, RegistryKey] = {}
        self._refused = {RESTS_ON[name]: name for name in RESTS_ON if document[name]["status"] != "value"}
        self._refused |= {KEYS[name].lower(): name for name in KEYS if document[name]["status"] != "value"}
        self._fill_host()
        for machine in self._value("machines", ()):
            self._fill_machine(machine)
        self._fill_registry()

    def computer(self) -> str:
        return str(self._document["computer"])

    def bits(self) -> int:
        return int(self._value("windows", {"bits": 64})["bits"])

    def instances(self, name: str) -> Sequence[WmiInstance]:
        if name in self._refused:
            self._refuse(self._refused[name])
        return self._instances[name]

    def disk(self, path: str) -> WmiInstance:
        if path not in self._disks:
            raise NotRead("0x80070002", "the file does not exist")
        return self._disks[path]

    def key(self, path: str, *, of_user: bool = False) -> RegistryKey:
        if path.lower() in self._refused:
            self._refuse(self._refused[path.lower()])
        found = self._keys.get(f"{'user' if of_user else 'machine'} {path.lower()}")
        if found is None:
            raise NotRead("PathNotFound", f"there is no {path}")
        return found

    def is_elevated(self) -> bool:
        return bool(self._asked("elevated"))

    def is_hyperv_administrator(self) -> bool:
        return bool(self._asked("hyperv_administrator"))

    def is_script_running(self) -> bool:
        raise NotRead("NotLookedFor", "the script does not look")

    def scheduler(self) -> int:
        return int(self._asked("scheduler"))

    def journal(self) -> tuple[str, str]:
        journal = self._asked("journal")
        return journal["owner"], journal["text"]

    def modules(self) -> Sequence[str]:
        return tuple(self._asked("module"))

    def _asked(self, name: str) -> Any:
        if self._document[name]["status"] != "value":
            self._refuse(name)
        return self._document[name]["value"]

    def _refuse(self, name: str) -> None:
        probe = self._document[name]
        raise NotRead(probe["error"], probe["message"], denied=probe["status"] == "denied")

    def _value(self, name: str, default: Any) -> Any:
        probe = self._document[name]
        return probe["value"] if probe["status"] == "value" else default

    def _add(self, name: str, **values: Any) -> None:
        """An instance as scripts are given it: all properties are there, numbers of 64 bits are text."""
        assert values.keys() <= set(QUERIES[name]), name
        types = FACTS.get(name, {})
        typed = {key: str(value) if types.get(key) == "uint64" else value for key, value in values.items()}
        self._instances[name].append({**dict.fromkeys(QUERIES[name]), **typed})

    def _fill_host(self) -> None:
        facts = self._value("hypervisor", None)
        if self._value("host_visible", False):
            self._add("Msvm_ComputerSystem", Name=self.computer(), ElementName=self.computer(), EnabledState=2)
        if facts:
            self._add(
                "Msvm_VirtualSystemManagementServiceSettingData",
                DefaultVirtualHardDiskPath=facts["disk_folder"],
                NumaSpanningEnabled=facts["numa_spanning"],
            )
        running = self._value("hypervisor_running", None)
        memory = str(facts["memory"]) if facts else None
        self._add("Win32_ComputerSystem", TotalPhysicalMemory=memory, HypervisorPresent=running)
        if self._value("counters", False):
            self._add(wmi_document.COUNTERS, Name="_Total")
        for number, node in enumerate(self._value("numa", ())):
            processors = facts["logical_processors"] if facts and number == 0 else 0
            blocks = str(node["memory_available"])
            self._add(
                "Msvm_NumaNode",
                NumberOfLogicalProcessors=processors,
                CurrentlyConsumableMemoryBlocks=blocks,
            )
        for socket in self._value("processors", ()):
            self._add(
                "Win32_Processor",
                Name=socket["name"],
                NumberOfCores=socket["cores"],
                NumberOfLogicalProcessors=socket["logical"],
            )
        for name in self._value("switches", ()):
            self._add("Msvm_VirtualEthernetSwitch", Name=f"id of {name}", ElementName=name)
        for guest in self._value("guests", ()):
            more = ['<INSTANCE CLASSNAME="Msvm_KvpExchangeDataItem"><VALUE>OSVersion</VALUE></INSTANCE>']
            items = [*guest["system"], *more]
            self._add(
                "Msvm_KvpExchangeComponent", SystemName=guest["machine"].upper(), GuestIntrinsicExchangeItems=items
            )
        for service in self._value("shutdown_services", ()):
            system = service["machine"].upper()
            status, enabled = service["status"], service["enabled"]
            self._add("Msvm_ShutdownComponent", SystemName=system, EnabledState=enabled, OperationalStatus=status)
        for disk in self._value("virtual_disks", ()):
            if disk["type"]:
                number = numbers(wmi_document.DISK_TYPES)[disk["type"]]
                self._disks[disk["path"]] = {"Type": str(number), "ParentPath": disk["parent"] or None}

    def _fill_machine(self, machine: Mapping[str, Any]) -> None:
        system = machine["id"].upper()
        realised = f"Microsoft:{system}"
        critical = machine["state"].endswith("Critical")
        state = numbers(wmi_document.STATES)[machine["state"].removesuffix("Critical")]
        status = [wmi_document.DEGRADED] if critical else [2]
        name = machine["name"]
        mode = numbers(wmi_document.REPLICATION_MODES)[machine.get("replication_mode") or "None"]
        known = {"ElementName": name, "EnabledState": state, "OperationalStatus": status, "ReplicationMode": mode}
        self._add("Msvm_ComputerSystem", Name=system, **known)
        if machine["clustered"] == "True":
            self._add(wmi_document.CLUSTER, Type="Virtual Machine", PrivateProperties={"VmID": system})
        self._settings(realised, wmi_document.REALISED, machine)
        self._link("Msvm_SettingsDefineState", ManagedElement=system, SettingData=realised)
        for number in range(machine["checkpoint_count"]):
            # A checkpoint keeps settings of its own, which must not be taken for the machine's.
            checkpoint = f"Microsoft:checkpoint {number} of {system}"
            self._settings(checkpoint, "Microsoft:Hyper-V:Snapshot:Realized", {**machine, "notes": "old"})
            self._link("Msvm_SnapshotOfVirtualSystem", Antecedent=system, Dependent=checkpoint)
        self._devices(realised, machine)

    def _settings(self, instance: str, kind: str, machine: Mapping[str, Any]) -> None:
        firmware = {each["machine"]: each for each in self._value("firmware", ())}.get(machine["id"], {})
        templates = {template: guid for guid, template in wmi_document.TEMPLATES.items()}
        self._add(
            wmi_document.SETTINGS,
            InstanceID=instance,
            VirtualSystemType=kind,
            VirtualSystemSubType=f"Microsoft:Hyper-V:SubType:{machine['generation']}",
            Notes=[machine["notes"]],
            AutomaticStartupAction=numbers(wmi_document.START_ACTIONS)[machine["start_action"]],
            AutomaticShutdownAction=numbers(wmi_document.STOP_ACTIONS)[machine["stop_action"]],
            UserSnapshotType=numbers(wmi_document.CHECKPOINTS)[machine["checkpoints"]],
            SecureBootEnabled=firmware.get("secure_boot") == "On",
            SecureBootTemplateId=templates.get(firmware.get("template", ""), "").upper() or None,
        )

    def _devices(self, realised: str, machine: Mapping[str, Any]) -> None:
        groups = {each["instance"]: each for each in self._value("cpu_groups", ())}
        own = next((key for key in groups if machine["id"] in key.lower()), rf"{realised}\cpu\0")
        setting = groups.get(own, {"reservation": machine["reserve"] * 1000, "group": ""})
        threads = machine["threads_per_core"]
        self._add(
            "Msvm_ProcessorSettingData",
            InstanceID=own,
            VirtualQuantity=machine["processors"],
            Reservation=setting["reservation"],
            Limit=machine["limit"] * 1000,
            Weight=machine["weight"],
            CpuGroupId=setting["group"],
            **({"HwThreadsPerCore": threads} if threads else {}),
        )
        memory = rf"{realised}\memory"
        self._add(
            "Msvm_MemorySettingData",
            InstanceID=memory,
            VirtualQuantity=machine["memory"] // MIB,
            DynamicMemoryEnabled=machine["dynamic_memory"],
        )
        parts = [own, memory]
        for number, path in enumerate(machine["disks"]):
            parts.append(rf"{realised}\disk\{number}")
            self._add(
                "Msvm_StorageAllocationSettingData",
                InstanceID=parts[-1],
                ResourceSubType=wmi_document.DISK,
                HostResource=[path],
            )
        for part in parts:
            self._link("Msvm_VirtualSystemSettingDataComponent", GroupComponent=realised, PartComponent=part)

    def _link(self, name: str, **ends: str) -> None:
        self._add(name, **{end: self._path(end, value) for end, value in ends.items()})

    def _path(self, end: str, value: str) -> str:
        if end in ("ManagedElement", "Antecedent"):
            return f'\\\\CELL\\root:Msvm_ComputerSystem.CreationClassName="Msvm_ComputerSystem",Name="{value}"'
        return reference("Msvm_AnySettingData", "InstanceID", value)

    def _fill_registry(self) -> None:
        profile = wmi_document.PROFILE_KEY
        self._key(profile, self._value("profile", None))
        tasks = self._value("tasks", None)
        self._key(rf"{profile}\Tasks", None if tasks is None else [], [task["name"] for task in tasks or ()])
        for task in tasks or ():
            self._key(rf"{profile}\Tasks\{task['name']}", task["values"])
        records = self._value("records", None)
        applications = dict.fromkeys(record["application"] for record in records or ())
        self._key(wmi_document.RECORDS_KEY, None if records is None else [], list(applications))
        for application in applications:
            own = [record for record in records if record["application"] == application]
            self._key(rf"{wmi_document.RECORDS_KEY}\{application}", [], [record["task"] for record in own])
            for record in own:
                self._key(rf"{wmi_document.RECORDS_KEY}\{application}\{record['task']}", record["values"])
        windows = self._value("windows", None)
        if windows:
            self._texts(
                wmi_document.WINDOWS_KEY,
                CurrentBuildNumber=str(windows["build"]),
                InstallationType=windows["installation"],
            )
        self._texts(wmi_document.CRYPTOGRAPHY_KEY, MachineGuid=self._value("machine_id", ""))
        self._texts(wmi_document.ENGINE_KEY, PowerShellVersion=self._value("powershell", {"version": ""})["version"])
        keys = {"MachinePolicy": (wmi_document.POLICY_KEY, False), "UserPolicy": (wmi_document.POLICY_KEY, True)}
        keys |= {"LocalMachine": (wmi_document.SHELL_KEY, False), "CurrentUser": (wmi_document.SHELL_KEY, True)}
        for policy in self._value("execution_policy", ()):
            if policy["scope"] in keys and policy["policy"] != "Undefined":
                path, of_user = keys[policy["scope"]]
                self._texts(path, of_user=of_user, ExecutionPolicy=policy["policy"])

    def _texts(self, path: str, *, of_user: bool = False, **texts: str) -> None:
        values = [{"name": name, "kind": "String", "data": text} for name, text in texts.items()]
        self._key(path, values, of_user=of_user)

    def _key(
        self, path: str, values: Sequence[Mapping[str, Any]] | None, keys: Sequence[str] = (), *, of_user: bool = False
    ) -> None:
        if values is not None:
            found = [(value["name"], value["kind"], value["data"]) for value in values]
            self._keys[f"{'user' if of_user else 'machine'} {path.lower()}"] = RegistryKey(values=found, keys=keys)


def numbers(names: Mapping[int, str]) -> dict[str, int]:
    """By name."""
    return {name: number for number, name in names.items()}
