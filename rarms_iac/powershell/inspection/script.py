"""A script as its checks see it: text, tree, its own functions, and the calls that it makes."""

from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from typing import TYPE_CHECKING

from rarms_iac.model.diagnostics import Diagnostic, Finding, Place
from rarms_iac.powershell.inspection.allowed import Lists, ScriptKind, lists_of
from rarms_iac.powershell.templates import ENTRY, MEASURING_ENTRY
from rarms_iac.powershell.tree import text_of, walk

if TYPE_CHECKING:
    from tree_sitter import Node


@dataclass(frozen=True, slots=True, kw_only=True)
class Function:
    """A function of the script: its parameters by name, and whether each is a switch."""

    name: str
    parameters: Mapping[str, bool]
    node: "Node"


@dataclass(frozen=True, slots=True, kw_only=True)
class GivenParameter:
    """A parameter of a call as it is written, and what stands behind it."""

    name: str
    value: "Node | None"
    node: "Node"


@dataclass(frozen=True, slots=True, kw_only=True)
class CommandCall:
    """A command: its name as written, empty where it is no plain name."""

    name: str
    operator: str
    given: tuple[GivenParameter, ...]
    loose: tuple["Node", ...]  # values without a parameter; a switch may stand before one
    piped: bool
    node: "Node"


@dataclass(frozen=True, slots=True, kw_only=True)
class Script:
    """A script that PowerShell's grammar and our tokens understand."""

    name: str
    text: str
    root: "Node"
    kind: ScriptKind
    functions: Mapping[str, Function]  # its own, by name in lower case
    given: Mapping[str, Function]  # those of the fixed parts that it carries
    nodes: tuple["Node", ...]  # all of them, in the order of the text

    @property
    def lists(self) -> Lists:
        """The lists of all that it may be made of."""
        return lists_of(self.kind)

    @property
    def entry(self) -> str:
        """The function that its last line calls."""
        return MEASURING_ENTRY if self.kind is ScriptKind.MEASURE else ENTRY

    def problem(self, finding: Finding, node: "Node", detail: str, advice: str) -> Diagnostic:
        """One case of a finding, where the node stands."""
        at = node.start_point
        place = Place(file=self.name, line=at.row + 1, column=at.column + 1)
        return finding.at(place, detail, advice)


def functions_of(root: "Node") -> dict[str, Function]:
    """The functions that a tree defines, by name in lower case; a name in doubt is defined twice and kept once."""
    return {
        function.name.lower(): function
        for node in walk(root)
        if node.type == "function_statement"
        for function in _function(node)
    }


def _function(node: "Node") -> Iterator[Function]:
    for child in node.children:
        if child.type == "function_name":
            yield Function(name=text_of(child), parameters=_parameters(node), node=node)


def _parameters(function: "Node") -> dict[str, bool]:
    parameters: dict[str, bool] = {}
    for node in walk(function):
        if node.type == "script_parameter":
            words = [text_of(child) for child in node.children]
            name = next(word for word in words if word.startswith("$"))
            parameters[name.removeprefix("$")] = any("[switch]" in word.lower() for word in words)
    return parameters


def calls_of(root: "Node") -> Iterator[CommandCall]:
    """Every command below a node."""
    for node in walk(root):
        if node.type == "command":
            yield call_of(node)


def call_of(node: "Node") -> CommandCall:
    """The command that a node is, taken apart."""
    name = operator = ""
    given: list[GivenParameter] = []
    loose: list[Node] = []
    for child in node.children:
        match child.type:
            case "command_invokation_operator":
                operator = text_of(child)
            case "command_name":
                name = text_of(child)
            case "command_elements":
                _elements(child, given, loose)
            case _:
                pass
    first = node.parent.children[0] if node.parent else node
    return CommandCall(
        name=name, operator=operator, given=tuple(given), loose=tuple(loose), piped=first.id != node.id, node=node
    )


def _elements(elements: "Node", given: list[GivenParameter], loose: list["Node"]) -> None:
    waiting: Node | None = None
    for child in elements.children:
        if child.type == "command_argument_sep":
            continue
        if child.type == "command_parameter":
            if waiting is not None:
                given.append(_given(waiting, None))
            waiting = child
        elif waiting is not None:
            given.append(_given(waiting, child))
            waiting = None
        else:
            loose.append(child)
    if waiting is not None:
        given.append(_given(waiting, None))


def _given(node: "Node", value: "Node | None") -> GivenParameter:
    return GivenParameter(name=text_of(node).removeprefix("-").removesuffix(":"), value=value, node=node)
