"""`hosts` of the document -> hosts of the System."""

from typing import assert_never

from rarms_iac.manifest.document.hosts import (
    ConnectBlock,
    FaultBlock,
    HostBlock,
    HypervHostBlock,
    KeepForHostBlock,
    LinuxBlock,
    SimulatedBlock,
)
from rarms_iac.model.system import (
    Connect,
    Fault,
    Host,
    HostSettings,
    HypervHost,
    KeepForHost,
    LinuxHost,
    ProviderKind,
    SimulatedHost,
)


def to_host(name: str, block: HostBlock) -> Host:
    """A host with its defaults; its platform is its own name unless it says otherwise."""
    keep = block.keep_for_host or KeepForHostBlock()
    return Host(
        name=name,
        provider=block.provider,
        logical_processors=block.logical_processors,
        memory=block.memory,
        keep_for_host=KeepForHost(processor=keep.processor, memory=keep.memory),
        platform=block.platform or name,
        connect=to_connect(block.connect) if block.connect else None,
        settings=_settings(block),
        system_responsiveness=block.system_responsiveness,
    )


def to_connect(block: ConnectBlock) -> Connect:
    """How a remote system is reached."""
    return Connect(ssh=block.ssh, shell=block.shell)


def _settings(block: HostBlock) -> HostSettings:
    match block.provider:
        case ProviderKind.SIMULATED:
            return _simulated(block.simulated or SimulatedBlock())
        case ProviderKind.HYPERV:
            hyperv = block.hyperv or HypervHostBlock()
            return HypervHost(
                switch=hyperv.switch, image=hyperv.image, vm_path=hyperv.vm_path, generation=hyperv.generation
            )
        case ProviderKind.LINUX:
            linux = block.linux or LinuxBlock()
            return LinuxHost(slice=linux.slice, control_groups=linux.control_groups)
        case _:
            assert_never(block.provider)


def _simulated(block: SimulatedBlock) -> SimulatedHost:
    return SimulatedHost(
        windows_build=block.windows_build,
        guest_windows_build=block.guest_windows_build,
        client=block.client,
        scheduler=block.scheduler,
        smt=block.smt,
        administrator=block.administrator,
        faults={name: _fault(fault) for name, fault in (block.faults or {}).items()},
    )


def _fault(block: FaultBlock) -> Fault:
    return Fault(operation=block.operation, at=block.at, effect=block.effect, delay=block.delay, times=block.times)
