"""Where a data log is measured: the test partitions P1 and P2, their setup, and the platform below them."""

from dataclasses import dataclass

from rarms_iac.model.host import ProviderKind, SchedulerType

P1 = "rarms-p1"
"""The test partition of the components; what its mark calls it. No partition of a manifest may be called so."""

P2 = "rarms-p2"
"""The test partition of the interfering load."""

TEST_PARTITIONS = (P1, P2)

P2_WEIGHT = 10_000
"""The highest weight that Hyper-V and control groups know: what P1's own processors leave idle goes to P2."""

CONFINEMENT = f"P2 reserves all the rest, and has the weight {P2_WEIGHT}"
"""How P1 is held to CR while it is measured: a condition of a data log (docs/data-logs.md)."""

GROUP_CONFINEMENT = "control groups P1 and P2 weigh what they reserve, and P2 reserves all the rest"
"""How P1 is held to CR on Linux, where weight beside a reserve has no meaning."""


@dataclass(frozen=True, slots=True, kw_only=True)
class PartitionShape:
    """A test partition as it is made; its reserve is set for each setting."""

    name: str
    processors: int
    memory: int  # bytes
    limit: int
    weight: int


@dataclass(frozen=True, slots=True, kw_only=True)
class PlatformFacts:
    """The machine that was measured on, as far as it can change what is measured there."""

    provider: ProviderKind
    processor: str  # its model, as it names itself
    logical_processors: int
    smt: bool
    scheduler: SchedulerType
    guest_image: str  # what the test partitions run; empty: nothing of their own
    os_build: int  # 0: there is none


@dataclass(frozen=True, slots=True, kw_only=True)
class EnvironmentSetup:
    """What P1 and P2 are in those settings of a data log that count together; only the reserves differ between them."""

    members: tuple[str, ...]  # the components in P1, by name
    interference: str  # the load in P2, by its name in the manifest
    processors: int  # virtual ones, of P1; settings of other numbers do not count. P2 has as many as the host has LPs
    memory: int  # bytes, of P1
    limit: int  # of P1: per cent of each of its processors
    weight: int  # of P1
