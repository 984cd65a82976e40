"""Which control groups a machine has. Begin at `find_tree`."""

from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path

from rarms_iac.providers.cgroups.effects import LinuxEffects
from rarms_iac.providers.cgroups.groups import GroupTree
from rarms_iac.providers.cgroups.systemd import GroupTreeSystemd, slice_unit
from rarms_iac.providers.cgroups.versions import CONTROLLERS_V2, GroupTreeV1, GroupTreeV2

CONTROL_GROUPS = Path("/sys/fs/cgroup")
SYSTEMD_FOLDER = "run/systemd/system"
"""Below `/`: it is there where systemd is process 1 (sd_booted(3))."""

_CONTROLLERS_V1 = ("cpuset", "memory", "cpuacct", "cpu")  # cpu last: `GroupTree.names` looks there
_NO_QUOTAS = "quotas of processor time (CONFIG_CFS_BANDWIDTH)"


@dataclass(frozen=True, slots=True, kw_only=True)
class MissingFeatures:
    """The parts of the kernel, and the rights, that control groups need and that are not here."""

    names: tuple[str, ...]


def find_tree(
    slice_name: str, version: str = "automatic", effects: LinuxEffects | None = None, root: Path = CONTROL_GROUPS
) -> GroupTree | MissingFeatures:
    """Choose the version that a machine has, version 2 where it has both.

    Args:
        slice_name: the group below which those of rarms lie.
        version: automatic, v1 or v2.
        effects: of the machine; None: this one.
        root: where control groups are mounted: `sys/fs/cgroup` below the folder that is `/`.

    Returns:
        The groups below the slice, which need not be there yet; or what is missing (where both versions lack
        something: of version 1 where the machine has any of it).
    """
    effects = effects or LinuxEffects()
    unified = next(
        (path for path in (root, root / "unified") if _controllers(effects, path) >= set(CONTROLLERS_V2)), root
    )
    systemd_runs = effects.has_folder(root.parents[2] / SYSTEMD_FOLDER)
    missing = {"v1": tuple(_missing_v1(effects, root)), "v2": tuple(_missing_v2(effects, unified))}
    if version == "automatic":  # in version 1 systemd keeps no sets of processors
        has_v1 = any(effects.has_file(root / name / "cgroup.procs") for name in _CONTROLLERS_V1)
        version = "v2" if systemd_runs or not missing["v2"] or not has_v1 else "v1"
    if missing[version]:
        return MissingFeatures(names=missing[version])
    if version == "v1":
        return GroupTreeV1(effects, {name: root / name / slice_name for name in _CONTROLLERS_V1})
    if systemd_runs:
        return GroupTreeSystemd(effects, dict.fromkeys((*CONTROLLERS_V2, "cpuacct"), unified / slice_unit(slice_name)))
    return GroupTreeV2(effects, dict.fromkeys((*CONTROLLERS_V2, "cpuacct"), unified / slice_name))


def _missing_v1(effects: LinuxEffects, root: Path) -> Iterator[str]:
    for name in _CONTROLLERS_V1:
        if not effects.has_file(root / name / "cgroup.procs"):
            yield f"the controller {name} of version 1 at {(root / name).as_posix()}"
        elif not effects.is_writable(root / name):
            yield f"the right to make groups in {(root / name).as_posix()}"
    if effects.has_file(root / "cpu" / "cpu.shares") and not effects.has_file(root / "cpu" / "cpu.cfs_quota_us"):
        yield _NO_QUOTAS


def _missing_v2(effects: LinuxEffects, root: Path) -> Iterator[str]:
    offered, shown = _controllers(effects, root), root.as_posix()
    if not offered:
        yield f"version 2 of control groups at {shown} (kernel parameter systemd.unified_cgroup_hierarchy=1)"
        return
    for name in CONTROLLERS_V2:
        if name not in offered:
            yield f"the controller {name} of version 2 at {shown} (kernel parameter cgroup_enable={name})"
    if not effects.is_writable(root):
        yield f"the right to make groups in {shown}"
    groups = [root / name for name in effects.folders(root)]  # the root itself has neither file
    if any(effects.has_file(group / "cpu.weight") and not effects.has_file(group / "cpu.max") for group in groups):
        yield _NO_QUOTAS


def _controllers(effects: LinuxEffects, root: Path) -> frozenset[str]:
    try:
        return frozenset(effects.read(root / "cgroup.controllers").split())
    except OSError:
        return frozenset()
