"""The system as a picture: hosts with their partitions with their components, in Mermaid."""

from collections.abc import Iterable, Iterator, Sequence
from itertools import count

from rarms_iac.app.graph import CandidateGraph, LayoutGraph
from rarms_iac.model.layout import Layout
from rarms_iac.model.quantities import show_bytes, show_percent, show_processors
from rarms_iac.model.system import System
from rarms_iac.planner.combining.candidates import Node
from rarms_iac.planner.problem import by_name


def graph_text(graph: LayoutGraph) -> str:
    """Draw the hosts with what lies in them as a Mermaid flowchart, ending with a line end."""
    return _flowchart(graph.application, _layout_lines(graph.system, graph.layout))


def _layout_lines(system: System, layout: Layout) -> Iterator[str]:
    numbers = count()

    def node(*label: str) -> str:
        return f'n{next(numbers)}["{mermaid_quoted(*label)}"]'

    def component(name: str) -> str:
        drawn = system.components[name]
        return node(name, f"criticality {drawn.criticality}", *((f"task {drawn.task}",) if drawn.task else ()))

    for host in by_name(system.hosts):
        size = f"{show_processors(host.logical_processors)}, {show_bytes(host.memory)}"
        yield f"  subgraph {node(host.name, f'{host.provider.value}, {size}')}"
        for partition in layout.on(host.name):
            share = f"{show_percent(partition.settings.reserve)} of each of its VPs"
            reserve = f"{show_processors(partition.reserved)} reserved ({share})"
            yield f"    subgraph {node(partition.name, reserve, show_bytes(partition.settings.memory))}"
            yield from (f"      {component(name)}" for name in partition.components)
            yield "    end"
        yield from (f"    {component(name)}" for name, on in layout.on_hosts if on == host.name)
        yield "  end"


def _flowchart(title: str, lines: Iterable[str]) -> str:
    return "\n".join(("---", f'title: "{title}"', "---", "flowchart LR", *lines)) + "\n"


def mermaid_quoted(*lines: str) -> str:
    """Lines of text as the inside of a Mermaid string: what it would read as its own is written as an entity."""
    return "<br/>".join("".join(_MERMAID.get(character, character) for character in line) for line in lines)


_MERMAID = {'"': "#quot;", "#": "#35;", "&": "#amp;", "<": "#lt;", ">": "#gt;", ";": "#59;", "`": "#96;"}


def candidates_text(graph: CandidateGraph) -> str:
    """Draw the candidate graph as a Mermaid flowchart, ending with a line end."""
    return _flowchart(graph.application, _candidate_lines(graph.candidates))


def _candidate_lines(nodes: Sequence[Node]) -> Iterator[str]:
    numbers = {node.name: f"n{number}" for number, node in enumerate(nodes)}
    for node in nodes:
        yield f'  {numbers[node.name]}["{mermaid_quoted(*node.label)}"]'
    for node in nodes:
        arrow = "-->" if node.measured and node.is_gain else "-.->"
        for part in node.parts:
            yield f"  {numbers[part]} {arrow} {numbers[node.name]}"
