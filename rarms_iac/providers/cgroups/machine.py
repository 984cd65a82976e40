"""The machine below a Linux host's partitions: its facts, read from `/etc`, `/proc` and `/sys`."""

import os
import platform
import uuid
from dataclasses import dataclass
from pathlib import Path

from rarms_iac.model.host import Host, ProviderKind, SchedulerType
from rarms_iac.model.state import USUAL_DEADLINE_PERCENT, HostFacts, Rights
from rarms_iac.storage.reading import read_file

NAMESPACE = uuid.UUID("b0c2d7ee-3f0b-5a6f-9a55-6b1f0f6a7c11")
"""Ids of partitions, and of machines that have none of their own, are made in it."""

_LIMIT = 4096  # bytes: the longest file that is read
MEBIBYTE = 2**20


@dataclass(frozen=True, slots=True, kw_only=True)
class LinuxMachine:
    """A machine and its latest start."""

    id: str
    computer_name: str
    logical_processors: int
    memory: int  # bytes, whole MiB
    smt: bool
    boot: str  # id of its latest start
    deadline_percent: int = USUAL_DEADLINE_PERCENT  # of each processor, that the kernel admits for SCHED_DEADLINE


def this_machine() -> LinuxMachine:
    """Read the machine that this process runs on.

    Raises:
        OSError: this Linux has no `/proc`.
    """
    memory = os.sysconf("SC_PAGE_SIZE") * os.sysconf("SC_PHYS_PAGES")
    return read_machine(Path("/"), platform.node(), os.cpu_count() or 1, memory)


def read_machine(root: Path, computer_name: str, logical_processors: int, memory: int) -> LinuxMachine:
    """Read the machine whose files lie below a folder.

    Args:
        root: the folder that is `/` there.
        computer_name: as it calls itself.
        logical_processors: that are on.
        memory: in bytes.

    Raises:
        OSError: it has no `/proc`.
    """
    return LinuxMachine(
        id=_text(root / "etc/machine-id") or uuid.uuid5(NAMESPACE, computer_name).hex,
        computer_name=computer_name,
        logical_processors=logical_processors,
        memory=memory // MEBIBYTE * MEBIBYTE,
        smt=_text(root / "sys/devices/system/cpu/smt/active") == "1",
        boot=read_file(root / "proc/sys/kernel/random/boot_id", _LIMIT).decode("ascii").strip(),
        deadline_percent=_deadline_percent(root / "proc/sys/kernel"),
    )


def _deadline_percent(kernel: Path) -> int:
    """Return the part of each processor that the kernel admits for SCHED_DEADLINE; 0 where it does not say."""
    runtime, period = (int(_text(kernel / f"sched_rt_{name}_us") or 0) for name in ("runtime", "period"))
    return 100 if runtime < 0 else runtime * 100 // period if period else 0


def facts_of(host: Host, machine: LinuxMachine, group_processors: int) -> HostFacts:
    """The facts of the host that decisions rest on.

    Args:
        host: as the manifest describes it.
        machine: what rarms runs on.
        group_processors: how many of its processors control groups may use.
    """
    percent = machine.deadline_percent if group_processors == machine.logical_processors else 0
    return HostFacts(
        name=host.name,
        id=machine.id,
        provider=ProviderKind.LINUX,
        computer_name=machine.computer_name,
        os_build=0,
        client=False,
        scheduler=SchedulerType.NONE,
        smt=machine.smt,
        logical_processors=machine.logical_processors,
        memory=machine.memory,
        rights=Rights.PROVEN,  # `LinuxHostProvider.tree` has refused the host where they are missing
        deadline_percent=None if percent == USUAL_DEADLINE_PERCENT else percent,
    )


def _text(path: Path) -> str:
    try:
        return read_file(path, _LIMIT).decode("ascii").strip()
    except OSError:
        return ""
