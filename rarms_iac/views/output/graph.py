"""`rarms graph`: hosts, partitions and components."""

from dataclasses import dataclass
from typing import Literal

from rarms_iac.views.output.common import FORMAT_VERSION, Format


@dataclass(frozen=True, slots=True, kw_only=True)
class NodeOutput:
    """Something in a graph."""

    id: str
    is_a: Literal["host", "partition", "component"]
    name: str
    inside: str
    label: str


@dataclass(frozen=True, slots=True, kw_only=True)
class GraphOutput:
    """`rarms graph`."""

    format_version: Format = FORMAT_VERSION
    kind: Literal["graph"] = "graph"
    application: str
    nodes: tuple[NodeOutput, ...]
