"""The hosts that every contract is run against: the simulated one, and Linux with the kernel of this machine.

A provider joins by a `Bench` in `BENCHES`. Control groups are made below a slice that only the test has, and removed
after it; where they cannot be made, those tests are skipped.
"""

import hashlib
import os
import shutil
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass, replace
from pathlib import Path

import pytest

from rarms_iac.model.host import Host, ProviderKind
from rarms_iac.providers.cgroups.effects import LinuxEffects
from rarms_iac.providers.cgroups.groups import GroupTree
from rarms_iac.providers.cgroups.machine import read_boot, read_facts
from rarms_iac.providers.cgroups.provider import STATE_FOLDER, LinuxHostProvider
from rarms_iac.providers.cgroups.trees import CONTROL_GROUPS, find_tree
from rarms_iac.providers.channel import ProgramChannel
from rarms_iac.providers.interface import StepwiseHost
from rarms_iac.providers.simulated.provider import SimulatedHostProvider
from rarms_iac.storage import disk
from tests import builders
from tests.crashing import CrashingDisk
from tests.effort import LONG
from tests.files import copy_files
from tests.needs import reason_to_skip, require


def on_linux(host: Host) -> Host:
    """This machine as a Linux host."""
    return replace(host, provider=ProviderKind.LINUX)


@dataclass(frozen=True)
class Bench:
    """A kind of host: each call opens the same host again, as a new process would."""

    open: Callable[[Host, Path], StepwiseHost]
    needs: tuple[str, ...] = ()
    stride: int = 1  # each of so many effects is tried as the place of a crash
    described: Callable[[Host], Host] = on_linux  # as a manifest describes it
    is_here: bool = True  # its effects are those of this process, so that it can crash at each
    is_windows: bool = False  # it has registries, disks, secure boot, and a description of the machine
    without_channel: Callable[[Host, Path], StepwiseHost] | None = (
        None  # opens the same host, where a channel leads to it
    )

    def furnished(self, folder: Path) -> StepwiseHost:
        """The host for what comes before what is tested: without a channel, which takes long."""
        return (self.without_channel or self.open)(builders.a_host(), folder)


def slice_of(folder: Path) -> str:
    """The slice below which the host of this folder makes its control groups."""
    return f"rarms-test-{os.getpid()}-{hashlib.sha256(str(folder).encode()).hexdigest()[:8]}"


def groups_of(folder: Path) -> GroupTree:
    """The control groups of the host of this folder."""
    tree = find_tree(slice_of(folder))
    assert isinstance(tree, GroupTree), tree
    return tree


def open_simulated(host: Host, folder: Path) -> SimulatedHostProvider:
    return SimulatedHostProvider(host, folder / ".rarms/hosts/onboard.json")


def open_linux(host: Host, folder: Path, boot: str = "") -> LinuxHostProvider:
    """This machine, with the processors and the memory that the manifest tells; `boot`: another start of it."""
    facts = read_facts(on_linux(host), LinuxEffects())
    facts = replace(facts, logical_processors=host.logical_processors, memory=int(host.memory))
    return LinuxHostProvider(on_linux(host), folder, groups_of(folder), facts, boot or read_boot(LinuxEffects()))


def shell_channel(*words: str) -> ProgramChannel:
    """A channel that runs its commands on this machine, behind this program."""
    return ProgramChannel(host="onboard", target="ann@onboard", words=words or ("sh", "-c"))


BENCHES = {
    "linux": Bench(open_linux, needs=("control-groups",), stride=1 if LONG else 13),
    "simulated": Bench(
        open_simulated,
        described=lambda host: host,
        stride=1 if LONG else 9,
        is_windows=True,
    ),
}
HERE = {name: bench for name, bench in BENCHES.items() if bench.is_here}
WINDOWS = {name: bench for name, bench in BENCHES.items() if bench.is_windows}


def copy_host(source: Path, target: Path) -> None:
    """Copy what a host keeps in a folder, and its control groups where it has any, for the host of another folder."""
    copy_files(source, target)
    if not reason_to_skip("control-groups"):
        originals, copies = groups_of(source), groups_of(target)
        for name in originals.names():
            copies.make(name)
            copies.write(name, originals.read(name))


@contextmanager
def kernel_effects_on_disk() -> Iterator[None]:
    """Inside, each effect on control groups is also one of the disk in use, so that a crash may come before it."""
    with pytest.MonkeyPatch.context() as patch:
        for name in ("write", "make", "remove"):
            patch.setattr(LinuxEffects, name, _counted(name, getattr(LinuxEffects, name)))
        yield


def _counted(name: str, effect: Callable[..., None]) -> Callable[..., None]:
    def counted(effects: LinuxEffects, path: Path, *rest: object) -> None:
        in_use = disk.current()
        if isinstance(in_use, CrashingDisk):
            in_use.meet(f"{name} {path}")
        effect(effects, path, *rest)

    return counted


def opened_bench(name: str) -> Iterator[Bench]:
    """The bench of this name for one test; what it made in the kernel is removed."""
    require(*BENCHES[name].needs)
    yield BENCHES[name]
    if BENCHES[name].needs:  # `os.walk` passes over what other tests remove meanwhile
        made = {group for _, groups, _ in os.walk(CONTROL_GROUPS) for group in groups}
        for group in made:
            if group.startswith(f"rarms-test-{os.getpid()}-"):
                _remove_slice(group)


def forget_groups(folder: Path) -> None:
    """Remove the control groups of the host of this folder, where it has any."""
    if not reason_to_skip("control-groups"):
        _remove_slice(slice_of(folder))


def forget_host(folder: Path) -> None:
    """Remove the control groups and the state of the host of this folder."""
    forget_groups(folder)
    shutil.rmtree(STATE_FOLDER / slice_of(folder), ignore_errors=True)
    (STATE_FOLDER / f"{slice_of(folder)}.threads").unlink(missing_ok=True)


def _remove_slice(name: str) -> None:
    tree = find_tree(name)
    assert isinstance(tree, GroupTree), tree
    for group in tree.names():
        tree.remove(group)


@pytest.fixture(params=sorted(BENCHES))
def bench(request: pytest.FixtureRequest) -> Iterator[Bench]:
    """Each kind of host."""
    yield from opened_bench(request.param)


@pytest.fixture(params=sorted(HERE))
def bench_here(request: pytest.FixtureRequest) -> Iterator[Bench]:
    """Each kind of host that this process changes itself."""
    yield from opened_bench(request.param)


@pytest.fixture(params=sorted(WINDOWS))
def windows_bench(request: pytest.FixtureRequest) -> Iterator[Bench]:
    """Each kind of host that is a Windows, or behaves like one."""
    yield from opened_bench(request.param)
