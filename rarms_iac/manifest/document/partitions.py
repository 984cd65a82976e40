"""`partitions`: what is fixed of partitions; without an entry each component has one of its own name."""

from typing import Annotated

from pydantic import Field

from rarms_iac.manifest.document.base import Block, Maybe, optional
from rarms_iac.manifest.document.components import CpuBlock
from rarms_iac.manifest.document.hosts import ConnectBlock
from rarms_iac.manifest.document.quantities import PositiveMemory, Wait
from rarms_iac.manifest.document.texts import Filled, Name
from rarms_iac.model.system import StartMode


class HypervPartitionBlock(Block):
    """What only Hyper-V needs to know; absent: as the host's own `hyperv` block says."""

    generation: Maybe[Annotated[int, Field(ge=1, le=2)]] = optional("1 or 2; it never changes after creation.")
    switch: Maybe[Filled] = optional("The virtual switch it is connected to.")
    image: Maybe[Filled] = optional("The disk image its disk is a child of.")
    vm_path: Maybe[Filled] = optional("The folder on the host where it is kept.")


class GuestBlock(Block):
    """How rarms reaches inside."""

    connect: Maybe[ConnectBlock] = optional("How the guest is reached.")
    credential: Maybe[Filled] = optional("The name under which a credential is kept; never the credential itself.")


class PartitionStopBlock(Block):
    """How a partition is stopped, where a change needs it off: its guest is asked, then it is turned off."""

    grace: Wait = optional(
        "How long its guest may take to shut down before it is turned off: `90 s`; at most 1 h.", "120 s"
    )


class PartitionBlock(Block):
    """What is fixed of a partition."""

    components: Maybe[Annotated[list[Name], Field(min_length=1)]] = optional(
        "The components in it; absent: the component of its name."
    )
    processors: Maybe[Annotated[int, Field(ge=1, le=2048)]] = optional(
        "Its virtual processors; absent: the most that one of its components asks for."
    )
    memory: Maybe[PositiveMemory] = optional("Its memory; absent: the sum of its components'.")
    cpu: Maybe[CpuBlock] = optional("What is fixed of its CPU; absent: as its components say.")
    protect: bool = optional("Whether its removal is an error.", False)
    start: Annotated[StartMode, Field(strict=False)] = optional(
        "`automatic`: it is wanted running; `manual`: rarms leaves that to you.", "automatic"
    )
    stop: Maybe[PartitionStopBlock] = optional("How it is stopped; absent: its guest has 120 s of grace.")
    hyperv: Maybe[HypervPartitionBlock] = optional("What only Hyper-V needs to know.")
    guest: Maybe[GuestBlock] = optional("How rarms reaches inside.")
