"""What is held true of the templates of scripts once and for all: what they may be made of, and the names in it.

In: the text of a script, whole. Out: problems, each `line: what is wrong`.
"""

from collections.abc import Iterator
from dataclasses import dataclass
from functools import cached_property

from tree_sitter import Node

from tests.powershell_lint import allowed
from tests.powershell_lint.cmdlets import cmdlet, spelling
from tests.powershell_lint.tree import CommandCall, calls_of, line_number, parse, text_of, walk

Problem = tuple[Node, str]


@dataclass(frozen=True)
class Function:
    """A function of the script: its parameters by name, and whether each is a switch."""

    name: str
    parameters: dict[str, bool]
    node: Node


@dataclass(frozen=True)
class Script:
    """A script with its tree; one that reads only may use less."""

    root: Node
    reading: bool

    @cached_property
    def nodes(self) -> list[Node]:
        """All of them, in the order of the text."""
        return list(walk(self.root))

    @cached_property
    def functions(self) -> dict[str, Function]:
        """Its own, by name in lower case."""
        return {
            text_of(name).lower(): Function(text_of(name), _parameters(node), node)
            for node in self.nodes
            if node.type == "function_statement"
            for name in node.children
            if name.type == "function_name"
        }


def problems(text: str, *, reading: bool = False) -> list[str]:
    """Everything that is wrong with a script, in no order."""
    script = Script(parse(text), reading)
    checks = (_constructs, _names, _commands, _hidden)
    joined = [f"{at}: the line is joined" for at, line in enumerate(text.splitlines(), start=1) if line.endswith(" `")]
    return joined + [f"{line_number(node)}: {problem}" for check in checks for node, problem in check(script)]


def _parameters(function: Node) -> dict[str, bool]:
    parameters: dict[str, bool] = {}
    for node in walk(function):
        if node.type == "script_parameter":
            texts = [text_of(child) for child in node.children]
            name = next(text for text in texts if text.startswith("$"))
            parameters[name.removeprefix("$")] = any("[switch]" in text.lower() for text in texts)
    return parameters


def _constructs(script: Script) -> Iterator[Problem]:
    for node in script.nodes:
        text = text_of(node)
        match node.type:
            case "command_name" | "command_parameter" | "generic_token" | "variable" if "`" in text:
                yield node, f"{text} hides a character"
            case kind if node.is_named and kind not in allowed.CONSTRUCTS:
                yield node, f"a {kind}"
            case "command_invokation_operator" if text != "&":
                yield node, f"{text} runs a file or a block in this scope"
            case "command_name_expr" if text not in allowed.BLOCKS:
                yield node, f"& runs {text}, which is not named"
            case "variable" if text.startswith("@"):
                yield node, f"{text} hides which parameters are given"
            case "comparison_expression" if _compares_text_by_culture(node):
                yield node, f"{text} compares text by culture, without case: ask Test-Same"
            case "member_name" if [child.type for child in node.children] != ["simple_name"]:
                yield node, f"the member {text} is named by a value"
            case _:
                pass


def _compares_text_by_culture(node: Node) -> bool:
    """Whether an operand of -eq or -ne is text by its form; the stand-in finds the others that matter."""
    parts = [text_of(child) for child in node.children]
    return len(parts) == 3 and parts[1] in {"-eq", "-ne"} and any(part.startswith(("'", "[string]")) for part in parts)


_OPERATORS = ("comparison_operator", "format_operator", "assignement_operator")
_BRACKETS = allowed.words("{ } ( ) [ ] @( @{ ; : & $_") | {" ", '"'}


def _names(script: Script) -> Iterator[Problem]:
    """Every type, member, operator and variable."""
    assigned = [text_of(node) for node in script.nodes if node.type == "variable" and _is_assigned(node)]
    own = {*assigned, *map(str.lower, assigned)}
    types = allowed.READING_TYPES if script.reading else allowed.TYPES
    members = allowed.READING_MEMBERS if script.reading else allowed.MEMBERS
    for node in script.nodes:
        text = text_of(node)
        match node.type:
            case "type_spec" if text not in types:
                yield node, f"the type {text}"
            case "member_name" if text not in members:
                yield node, f"the member {text}"
            case "variable" if not _is_known(node, text, own):
                yield node, f"the variable {text}"
            case _ if _is_operator(node) and text not in allowed.OPERATORS:
                yield node, f"the operator {text}"


def _is_operator(node: Node) -> bool:
    """Punctuation and dashed words that are no names, keywords or brackets."""
    if node.is_named or node.type in _BRACKETS or node.child_count:
        return node.type in _OPERATORS
    return not node.type.replace("_", "").isalpha()


def _is_known(node: Node, text: str, own: set[str]) -> bool:
    if not _is_assigned(node):
        return text in allowed.VARIABLES or text.lower() in own
    return not _is_special(text) or _assignment_of(node) in allowed.PINS


def _is_special(text: str) -> bool:
    """A variable that PowerShell itself keeps or heeds, or one of another scope or drive."""
    low = text.lower()
    scoped = ":" in low and not low.startswith("$script:")
    return low in allowed.SPECIAL or low.endswith("preference") or low.startswith("${") or scoped


def _assignment_of(node: Node) -> str:
    assignment: Node | None = node
    while assignment is not None and assignment.type != "assignment_expression":
        assignment = assignment.parent
    return text_of(assignment) if assignment else ""


def _is_assigned(node: Node) -> bool:
    """Whether a variable gets its value there: in an assignment, as a parameter, or in a loop's head."""
    parent = node.parent
    if parent is None:
        return False
    if parent.type == "script_parameter":
        return True
    if parent.type == "foreach_statement":
        return parent.children[[child.type for child in parent.children].index("(") + 1].id == node.id
    while parent is not None and parent.child_count == 1 and parent.type != "left_assignment_expression":
        parent = parent.parent
    if parent is not None and parent.type in {"cast_expression", "expression_with_unary_operator"}:  # [byte[]] $data =
        while parent is not None and parent.type != "left_assignment_expression" and _is_last(parent):
            parent = parent.parent
    return parent is not None and parent.type == "left_assignment_expression"


def _is_last(node: Node) -> bool:
    return node.parent is not None and node.parent.children[-1].id == node.id


def _commands(script: Script) -> Iterator[Problem]:
    """Each call: a function of the script, or a cmdlet of the lists, and names as they are written in full.

    Whether the parameters fit together, PowerShell itself says: `tests/real_powershell/test_texts.py`.
    """
    for call in calls_of(script.root):
        if call.name and call.operator:
            yield call.node, f"{call.operator} before {call.name}"
        if function := script.functions.get(call.name.lower()):
            yield from ((call.node, problem) for problem in _problems_of_function(call, function))
        elif call.name:
            yield from ((call.node, problem) for problem in _problems_of_cmdlet(call, script.reading))


def _problems_of_function(call: CommandCall, function: Function) -> Iterator[str]:
    if call.name != function.name or call.loose:
        yield f"{call.name} is written otherwise, or gets a value without a name"
    for name, value in call.given.items():
        if name not in function.parameters or (value is None) != function.parameters[name]:
            yield f"{function.name} has no such parameter -{name}"


def _problems_of_cmdlet(call: CommandCall, reading: bool) -> Iterator[str]:
    module, _, name = call.name.rpartition("\\")
    facts = cmdlet(name, module)
    if facts is None or facts.name != name or not facts.in_7:
        yield f"{call.name} is not a cmdlet of 5.1 and 7"
        return
    if call.name not in (allowed.READING_CMDLETS if reading else allowed.CMDLETS):
        yield f"{call.name} is not on the list"
    for given, value in call.given.items():
        parameter = facts.parameter(given)
        yield from spelling(facts, given)
        if parameter is not None and parameter.is_switch and value is not None:
            yield f"{name} is given a value without a name"
    if call.loose:
        yield f"{name} is given a value without a name"
    if (name == "New-Item" and "Force" in call.given) or (name == "Remove-Item" and call.given.keys() & _TAKING_ALL):
        yield f"{name} takes more than one key that holds nothing"


_TAKING_ALL = {"Force", "Recurse"}


def _hidden(script: Script) -> Iterator[Problem]:
    """Functions named like a cmdlet. PSScriptAnalyzer finds those of PowerShell's own cmdlets alone."""
    for function in script.functions.values():
        if cmdlet(function.name):
            yield function.node, f"{function.name} is a cmdlet already"
