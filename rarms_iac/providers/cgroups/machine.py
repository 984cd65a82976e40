"""The machine below a Linux host's partitions: its facts, read from `/etc`, `/proc` and `/sys`."""

import uuid
from collections import Counter
from collections.abc import Iterable
from dataclasses import replace
from pathlib import Path

from rarms_iac.model.host import Host, ProviderKind, SchedulerType, host_identity
from rarms_iac.model.state import USUAL_DEADLINE_PERCENT, HostFacts, ProcessorKind, Rights
from rarms_iac.providers.cgroups.effects import LinuxEffects
from rarms_iac.running.kernel_files import UnreadableFile, processor_list, whole_number

NAMESPACE = uuid.UUID("b0c2d7ee-3f0b-5a6f-9a55-6b1f0f6a7c11")
"""Ids of partitions, and of machines that have none of their own, are made in it."""

_ID, _MEMORY, _HOSTNAME = Path("/etc/machine-id"), Path("/proc/meminfo"), Path("/proc/sys/kernel/hostname")
_BOOT = Path("/proc/sys/kernel/random/boot_id")
_RUNTIME, _PERIOD = (Path(f"/proc/sys/kernel/sched_rt_{name}_us") for name in ("runtime", "period"))
_CPU = Path("/sys/devices/system/cpu")
_SMT, _PROCESSORS = _CPU / "smt/active", _CPU / "online"
MEBIBYTE = 2**20


def read_boot(effects: LinuxEffects) -> str:
    """Return the id of the machine's latest start. Raises OSError."""
    return effects.read(_BOOT)


def read_facts(host: Host, effects: LinuxEffects) -> HostFacts:
    """Return the facts of a machine, the host of the manifest.

    Raises:
        OSError: it has no `/proc`, or no `/sys`.
        UnreadableFile: a file is not as a Linux writes it.
    """
    name = effects.read(_HOSTNAME)
    runtime, period = (whole_number(file, _text(effects, file) or "0", least=-1) for file in (_RUNTIME, _PERIOD))
    online = effects.read(_PROCESSORS)
    if not (processors := processor_list(_PROCESSORS, online)):
        raise UnreadableFile(_PROCESSORS, online, "a list of processors")
    # Where the kernel does not say, it admits nothing; a negative runtime is all of the period.
    deadline = 100 if runtime < 0 else min(100, runtime * 100 // period) if period > 0 else 0
    return HostFacts(
        name=host.name,
        id=host_identity(_text(effects, _ID) or uuid.uuid5(NAMESPACE, name).hex),
        provider=ProviderKind.LINUX,
        computer_name=name,
        os_build=0,
        client=False,
        scheduler=SchedulerType.NONE,
        smt=_text(effects, _SMT) == "1",
        logical_processors=len(processors),
        memory=_memory_kib(effects.read(_MEMORY)) * 1024 // MEBIBYTE * MEBIBYTE,
        rights=Rights.PROVEN,  # `LinuxHostProvider.tree` has refused the host where they are missing
        processor_kinds=_kinds(effects, processors),
        deadline_percent=None if deadline == USUAL_DEADLINE_PERCENT else deadline,
    )


def _kinds(effects: LinuxEffects, processors: Iterable[int]) -> tuple[ProcessorKind, ...]:
    counts = Counter(_kind(effects, _CPU / f"cpu{number}") for number in processors)
    return tuple(sorted(replace(kind, processors=count) for kind, count in counts.items())) if len(counts) > 1 else ()


def _kind(effects: LinuxEffects, folder: Path) -> ProcessorKind:
    siblings, capacity, base = (
        folder / name for name in ("topology/thread_siblings_list", "cpu_capacity", "cpufreq/base_frequency")
    )
    return ProcessorKind(
        processors=1,
        threads=len(processor_list(siblings, _text(effects, siblings))),
        capacity=whole_number(capacity, _text(effects, capacity) or "0"),
        base_mhz=whole_number(base, _text(effects, base) or "0") // 1000,  # of kHz
    )


def _memory_kib(text: str) -> int:
    words = text.partition("MemTotal:")[2].split()
    if not words:
        raise UnreadableFile(_MEMORY, text, "a line MemTotal")
    return whole_number(_MEMORY, words[0])


def _text(effects: LinuxEffects, path: Path) -> str:
    return effects.read(path) if effects.has_file(path) else ""
