"""The speed of a Linux machine's processors, from `/sys` and `/proc/cpuinfo`; what a machine lacks is left out."""

from collections.abc import Iterable
from pathlib import Path

from rarms_iac.model.setting import MachineSpeed
from rarms_iac.providers.cgroups.effects import LinuxEffects
from rarms_iac.running.kernel_files import processor_list, whole_number

_CPU, _COOLING = Path("/sys/devices/system/cpu"), Path("/sys/class/thermal")
_ONLINE, _CPUINFO = _CPU / "online", Path("/proc/cpuinfo")
_HEAT = ("core_throttle_count", "package_throttle_count")
_COOLERS = ("processor", "thermal-cpufreq", "cpufreq", "cpu")
"""The begin of the types of cooling devices that slow processors, in small letters."""


def read_speed(effects: LinuxEffects) -> MachineSpeed:
    """Read the speed of the processors that are online.

    Raises:
        OSError: a file went away meanwhile.
        UnreadableFile: a file is not as a Linux writes it.
    """
    folders = [_CPU / f"cpu{number}" for number in processor_list(_ONLINE, effects.read(_ONLINE))]
    current = [khz // 1000 for khz in _numbers(effects, (folder / "cpufreq/scaling_cur_freq" for folder in folders))]
    limits = [khz // 1000 for khz in _numbers(effects, (folder / "cpufreq/scaling_max_freq" for folder in folders))]
    heat = _numbers(effects, (folder / "thermal_throttle" / name for folder in folders for name in _HEAT))
    return MachineSpeed(
        governor=read_governor(effects),
        mhz=_mean(current or _cpuinfo_mhz(effects)),
        limit_mhz=_mean(limits),
        throttled=sum(heat) + sum(_numbers(effects, _cooling_states(effects))),
    )


def read_governor(effects: LinuxEffects) -> str:
    """Return the governor of the processors, several in the order of their names; empty: the kernel sets none.

    Raises:
        OSError: a file went away meanwhile.
    """
    numbers = processor_list(_ONLINE, effects.read(_ONLINE))
    files = [_CPU / f"cpu{number}/cpufreq/scaling_governor" for number in numbers]
    return ", ".join(sorted({effects.read(file) for file in files if effects.has_file(file)}))


def _numbers(effects: LinuxEffects, files: Iterable[Path]) -> list[int]:
    return [whole_number(file, effects.read(file)) for file in files if effects.has_file(file)]


def _cooling_states(effects: LinuxEffects) -> list[Path]:
    """Return the files that are above 0 while a device slows processors, as on machines of ARM."""
    devices = [_COOLING / name for name in effects.folders(_COOLING) if name.startswith("cooling_device")]
    return [
        device / "cur_state"
        for device in devices
        if effects.has_file(device / "type") and effects.read(device / "type").lower().startswith(_COOLERS)
    ]


def _cpuinfo_mhz(effects: LinuxEffects) -> list[int]:
    lines = (line.partition(":") for line in effects.read(_CPUINFO).splitlines())
    return [round(float(value)) for name, _, value in lines if name.strip() == "cpu MHz"]


def _mean(values: list[int]) -> int:
    return round(sum(values) / len(values)) if values else 0
