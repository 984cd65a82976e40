"""`components`: the components of interest (CoIs), and those that are merely there."""

from typing import Annotated

from pydantic import Field

from rarms_iac.manifest.document.base import Block, Maybe, needed, optional
from rarms_iac.manifest.document.quantities import PositiveAmount, PositiveMemory, PositiveTime, Reserve, Share, Time
from rarms_iac.manifest.document.run import RunBlock
from rarms_iac.manifest.document.texts import Name, TaskName
from rarms_iac.manifest.document.thresholds import Thresholds
from rarms_iac.model.system import RunsOn

Weight = Annotated[int, Field(ge=1, le=10_000)]


class CpuBlock(Block):
    """What is fixed of the CPU; the rest is left to the planner."""

    reserve: Maybe[Reserve] = optional(
        "What is guaranteed: `measured` (the least that meets the thresholds, from the data log), "
        "a share of the host `70 %`, or processors `1.4 LP`. "
        "Absent: measured for a component with thresholds (apt), else nothing."
    )
    limit: Maybe[PositiveAmount] = optional("What it never gets more of: `60 %` or `1.2 LP`. Absent: the planner's.")
    weight: Maybe[Weight] = optional("Its part of what nobody reserved, 1 to 10000, 100 is usual.")


class SimulationBlock(Block):
    """What a job demands on a simulated host."""

    work: PositiveTime = needed("Processor time of a job: `61.6 ms`.")
    blocked: Time = optional("Time a job waits without the processor: `26.4 ms`.", "0 ms")
    varies: Share = optional("How much the work varies: its standard deviation over its mean, `5 %`.", "0 %")
    threads: int = optional("How many threads share the work.", 1, ge=1, le=4096)
    success_within: Maybe[PositiveTime] = optional("A job succeeds if it answers within this time; absent: always.")


class ComponentBlock(Block):
    """A component."""

    criticality: int = needed("How much it hurts when it misses its thresholds; larger hurts more.", ge=0, le=1_000_000)
    apt: Maybe[Thresholds] = optional(
        "Acceptable performance thresholds: what is good enough, by performance index. Absent: it has none."
    )
    run: Maybe[RunBlock] = optional("How it is started and measured; absent: rarms does not run it.")
    memory: PositiveMemory = optional("The memory it needs: `512 MiB`.", "512 MiB")
    processors: Maybe[Annotated[int, Field(ge=1, le=2048)]] = optional(
        "Virtual processors of its partition; absent: as many as the host has logical ones."
    )
    cpu: Maybe[CpuBlock] = optional("What is fixed of its CPU: reserve, limit, weight.")
    together: Maybe[list[Name]] = optional("Components that must share its partition.")
    apart: Maybe[list[Name]] = optional("Components that must never share its partition.")
    dedicated: bool = optional("Whether it has its partition for itself.", False)
    task: Maybe[TaskName] = optional("Its robotic task class (RC SS): what kind of work it does, never a priority.")
    hosts: Maybe[Annotated[list[Name], Field(min_length=1)]] = optional(
        "Hosts it may run on; absent: any whose platform has its measurements, or all where its reserve is fixed."
    )
    runs_on: Annotated[RunsOn, Field(strict=False)] = optional(
        "`partition`, or `host`: in the host's own operating system, with a task class but without a reserve.",
        "partition",
    )
    interference: Maybe[Name] = optional("The load its reservation must stand up to; absent: the policy's.")
    simulation: Maybe[SimulationBlock] = optional("What a job demands on a simulated host.")
