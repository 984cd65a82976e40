"""The steps of a script: its tree must be the template's tree with literals as leaves.

The calls and the names of table entries are taken out of the script, and must be on the lists here. The template is
filled again with exactly those and a harmless literal for every value. Where the tree of that differs from the tree of
the script, something else is in it. So what a script does can be read out of its tree.
"""

import re
from collections.abc import Iterable, Iterator, Mapping, Sequence
from itertools import zip_longest
from typing import TYPE_CHECKING

from rarms_iac.model.diagnostics import Diagnostic, Finding, Place
from rarms_iac.powershell.statements import (
    CommandCall,
    PlanPart,
    column_of,
    entries,
    guard_of,
    inner,
    only_call,
    plan_of,
    plan_statements,
    statements_of,
    top_statements,
)
from rarms_iac.powershell.templates import (
    ENTRY,
    FACT_NAMES,
    GUARD,
    HOST_FACT_NAMES,
    LATER_ROW,
    MEASURING_ENTRY,
    PLAN,
    ROW,
    STEP_CALL,
    TARGET,
    VM,
    StepText,
    TargetText,
    fact_lines,
    fill,
    guarded,
    impact_of,
    statement_lines,
    table_lines,
)
from rarms_iac.powershell.tree import ShapeNode, line_number, literal_of, parse, shape_of, text_of, walk

if TYPE_CHECKING:
    from tree_sitter import Node

STEP = Finding.error("RARMS211", "A step of a script has another form than rarms writes")
_ADVICE = "a step is a table of literals; its blocks hold calls of cmdlets and of the module's functions"


def _calls(text: str) -> Mapping[str, frozenset[str]]:
    """Read a list of calls, a line each: the name, then the parameters that it may have."""
    return {name: frozenset(parameters) for name, *parameters in map(str.split, text.strip().splitlines())}


_READERS = _calls(r"""
    Get-PartitionReading Machine Clustered Name Disk
    Get-TaskClassReading Task
    Get-GuestTaskClassReading Task Application Replace
    Get-DiskReading Path Parent Everywhere
    Get-FolderReading From To
""")
_SETTERS = _calls(r"""
    Hyper-V\New-VM Name Generation MemoryStartupBytes NoVHD SwitchName Path
    Hyper-V\Add-VMHardDiskDrive VM Path
    Hyper-V\New-VHD Path ParentPath Differencing
    Hyper-V\Remove-VM VM Force
    Hyper-V\Remove-VMNetworkAdapter VM
    Hyper-V\Rename-VM VM NewName
    Hyper-V\Set-VM VM AutomaticStartAction AutomaticStopAction CheckpointType
    Hyper-V\Set-VMFirmware VM EnableSecureBoot SecureBootTemplate FirstBootDevice
    Hyper-V\Set-VMMemory VM DynamicMemoryEnabled StartupBytes
    Hyper-V\Set-VMProcessor VM Count Reserve Maximum RelativeWeight
    Hyper-V\Start-VM VM
    FailoverClusters\Update-ClusterVirtualMachineConfiguration VMId
    Write-Mark
    Stop-Partition GraceMs
    Write-TaskValue Task Name Type Value
    Remove-TaskValue Task Name Keep
    Remove-TaskClass Task
    Write-TaskRecord Task Application Robot Digest Before
    Remove-TaskRecord Task Application
    Save-TaskRecord Task Application Digest
    Restore-TaskClass Task Application
    Remove-DiskFile Path
    Add-Folder Path
    Move-NewPartition From To
    Remove-PartitionFolder From To
""")
_WORK = "Partition Credential Name Kind Program Arguments Folder Environment Files PeriodTicks TimeoutMs Instances"
_MEASURES = _calls(f"""
    Add-TestPartition Name Processors Memory Limit Weight Generation Image Type Folder SecureBoot
    Add-GuestWork {_WORK}
""")
_VALUES = _calls(r"""
    Hyper-V\Get-VMHardDiskDrive VM
""")
_CAPACITY = _calls("Test-Capacity Processors Reserve Memory")
_SWITCHES = frozenset({"Clustered", "Differencing", "Everywhere", "Force", "NoVHD"})

_STEP_PARAMETERS = frozenset({"Action", "Before", "After", "Set"})
_LITERAL_PARAMETERS = ("Undoes", "Lost")
_OPTIONAL_PARAMETERS = frozenset({*_LITERAL_PARAMETERS, "Fits", "Same"})
_COLUMN = re.compile("[A-Za-z][A-Za-z0-9]*")
_HARMLESS = "'x'"


class _OtherForm(Exception):
    """The script has no template's form here."""

    def __init__(self, node: "Node", detail: str) -> None:
        super().__init__(detail)
        self.node = node
        self.detail = detail


def check_steps(name: str, root: "Node", entry: str) -> Iterator[Diagnostic]:
    """Compare a script's tree, without the lines of its module, with the template's."""
    try:
        template = _template_of(root, entry)
    except _OtherForm as other:
        yield _problem(name, line_number(other.node), other.detail)
    else:
        yield from _differences(name, list(top_statements(root)), list(top_statements(template)))


def check_recorded_plan(name: str, root: "Node") -> Iterator[Diagnostic]:
    """Compare the plan of a script with the template; another version, with other facts, may have made it."""
    try:
        template = _template_of_recorded(root)
    except _OtherForm as other:
        yield _problem(name, line_number(other.node), other.detail)
    else:
        yield from _differences(name, plan_statements(root)[1:], plan_statements(template)[1:])


def _template_of(root: "Node", entry: str) -> "Node":
    facts, parts = _facts_and_parts(root)
    values = {name: text_of(inner(value)) for name, value in facts.items()}
    promises = values.get("Guest") == "''" and values.get("Run") != "'undo'"
    names = FACT_NAMES | HOST_FACT_NAMES if promises else FACT_NAMES
    if facts.keys() != names:
        raise _OtherForm(root, f"the facts lack or add {', '.join(sorted(names ^ facts.keys()))}")
    return _filled_template(parts, entry, facts)


def _template_of_recorded(root: "Node") -> "Node":
    facts, parts = _facts_and_parts(root)
    for key, value in facts.items():
        if not key.isidentifier() or literal_of(inner(value)) is None:
            raise _OtherForm(value, f"the fact {key} is no literal")
    return _filled_template(parts, ENTRY, ())


def _differences(name: str, roots: Sequence["Node"], template: Sequence["Node"]) -> Iterator[Diagnostic]:
    """Yield a finding for the first place where the trees differ."""
    last = roots[-1].end_point.row + 1 if roots else 1
    for actual, expected in zip_longest(shape_of(roots), shape_of(template)):
        if actual != expected:
            detail = f"its tree has {_label(actual)} where the template's tree has {_label(expected)}"
            yield _problem(name, actual.line if actual else last, detail)
            return


def _label(node: ShapeNode | None) -> str:
    return (node.text or node.label.replace("_", " "))[:40] if node else "nothing"


def _problem(name: str, line: int, detail: str) -> Diagnostic:
    return STEP.at(Place(file=name, line=line, column=1), detail, _ADVICE, values={"script": name, "reason": detail})


def _facts_and_parts(root: "Node") -> "tuple[Mapping[str, Node], tuple[PlanPart, ...]]":
    table, parts = plan_of(root)
    facts = None if table is None else entries(table)
    if facts is None:
        raise _OtherForm(root, f"{PLAN} does not begin with the facts of the run")
    return facts, parts


def _filled_template(parts: Sequence[PlanPart], entry: str, facts: Iterable[str]) -> "Node":
    """The tree of the template, filled with the script's own calls and a harmless literal for each value.

    Raises:
        _OtherForm: the script has no form that the template can have, or calls something else.
    """
    text = fill(
        "script.ps1.j2",
        {
            **dict.fromkeys(("synopsis", "name", "usage", "module"), ""),
            **dict.fromkeys(("description", "notes", "requirements"), ()),
            "facts": fact_lines(dict.fromkeys(facts, _HARMLESS)),
            "entry": entry,
            "impact": impact_of("\n".join(text_of(call.node) for part in parts for call in part.calls)),
            "plan": [line for part in parts for line in _template_part(part, entry)],
        },
    )
    return parse(text.decode("ascii"))


def _template_part(part: PlanPart, entry: str) -> list[str]:
    """The calls; behind a table with the same columns in each row, and with no others in the calls."""
    if entry == MEASURING_ENTRY and not part.rows:
        return [f"    {_call_text(call, _MEASURES)}" for call in part.calls]
    lines = [line for call in part.calls for line in _template_lines(call, in_rows=bool(part.rows))]
    names = {name for call in part.calls for node in walk(call.node) if (name := column_of(node))}
    first = part.calls[0].node if part.calls else None
    for row in part.rows:
        if not names <= row.keys() or not all(map(_COLUMN.fullmatch, row)) or entry == MEASURING_ENTRY:
            raise _OtherForm(next(iter(row.values())), "a row of a table lacks a column, or has another form")
    if names and not part.rows and first is not None:
        raise _OtherForm(first, "a step names a column, and stands behind no table")
    if not part.rows:
        return lines
    table = table_lines([dict.fromkeys(row, _HARMLESS) for row in part.rows], [""] * len(part.rows))
    return [*table, *lines, "    }"]


def _template_lines(call: CommandCall, *, in_rows: bool) -> list[str]:
    if call.name == TARGET and call.given.keys() == {"Address", "Read"} | ({"Row"} if in_rows else set()):
        reading = _template_call(_value(call, "Read"), _READERS)
        address = _scalar_text(_value(call, "Address"), ROW)
        return statement_lines(TargetText(address=address, reading=reading, in_rows=in_rows))
    if call.name == STEP_CALL:
        return _template_step(call)
    raise _OtherForm(call.node, f"the plan holds {TARGET} and {STEP_CALL}, and nothing else")


def _value(call: CommandCall, name: str) -> "Node":
    value = call.given[name]
    if value is None:
        raise _OtherForm(call.node, f"-{name} has no value")
    return value


def _template_step(call: CommandCall) -> list[str]:
    if not _STEP_PARAMETERS <= call.given.keys() <= _STEP_PARAMETERS | _OPTIONAL_PARAMETERS:
        raise _OtherForm(call.node, "the step lacks a part, or has one too many")
    options = [(name, _scalar_text(_value(call, name), ROW)) for name in _LITERAL_PARAMETERS if name in call.given]
    if "Fits" in call.given:
        options.append(("Fits", f"{{ {_template_call(_value(call, 'Fits'), _CAPACITY)} }}"))
    return statement_lines(
        StepText(
            action=_scalar_text(_value(call, "Action"), ROW),
            same=_template_readings(_value(call, "Same")) if "Same" in call.given else {},
            before=_template_readings(_value(call, "Before")),
            after=_template_readings(_value(call, "After")),
            calls=_template_set(_value(call, "Set")),
            options=options,
        )
    )


def _template_readings(node: "Node") -> dict[str, str]:
    table = entries(node)
    if table is None:
        raise _OtherForm(node, "the readings before or after a step are no table")
    names = [key if key.isidentifier() else f"'{number}'" for number, key in enumerate(table)]
    return {name: _scalar_text(value, ROW) for name, value in zip(names, table.values(), strict=True)}


def _scalar_text(node: "Node", row: str) -> str:
    """A harmless literal for a literal, or the column that a value is, of the variable by which it is read there."""
    column = column_of(node)
    return f"{row}.{column}" if column else _HARMLESS


def _template_call(node: "Node", allowed: Mapping[str, frozenset[str]]) -> str:
    """Return the text of the only call in a block."""
    statements = list(statements_of(inner(node)))
    call = only_call(statements[0]) if len(statements) == 1 else None
    if call is None:
        raise _OtherForm(node, f"here stands one call of {', '.join(sorted(allowed))}, and nothing else")
    return _call_text(call, allowed)


def _template_set(node: "Node") -> tuple[str, ...]:
    """The calls of a `Set` block: cmdlets of Hyper-V, and writers of the module."""
    calls = []
    for statement in statements_of(inner(node)):
        guard = guard_of(statement)
        call = only_call(guard[1] if guard else statement)
        if call is None:
            raise _OtherForm(statement, "Set holds more than calls")
        text = _call_text(call, _SETTERS)
        calls.append(guarded(text, [_HARMLESS] * _count_of_names(guard[0])) if guard else text)
    if not calls:
        raise _OtherForm(node, "Set does nothing, or is no block")
    return tuple(calls)


def _count_of_names(condition: "Node") -> int:
    """How many names the question ahead of a call holds."""
    asked = only_call(condition)
    if asked is None or asked.name != GUARD or set(asked.given) != {"Name"} or asked.loose or asked.operator:
        raise _OtherForm(condition, f"a call of a step is asked for by {GUARD} alone")
    return sum(literal_of(node) is not None for node in walk(_value(asked, "Name")) if node.type == "string_literal")


def _call_text(call: CommandCall, allowed: Mapping[str, frozenset[str]]) -> str:
    """The call with the same parameters, and a harmless literal for each of its literals."""
    if call.name not in allowed or call.operator or call.loose:
        raise _OtherForm(call.node, f"a step must not do this: {text_of(call.node)[:40]}")
    if other := call.given.keys() - allowed[call.name]:
        raise _OtherForm(call.node, f"{call.name} gets no -{min(other)} from rarms")
    return " ".join([call.name, *(_parameter_text(call, name) for name in call.given)])


def _parameter_text(call: CommandCall, name: str) -> str:
    if name in _SWITCHES and call.given[name] is None:
        return f"-{name}"
    value = inner(_value(call, name))
    if name == "VM" and text_of(value) == VM:
        return f"-VM {VM}"
    if name in _SWITCHES or name == "VM":
        raise _OtherForm(value, f"-{name} of {call.name} is another than rarms writes")
    if literal_of(value) is not None or column_of(value):
        return f"-{name} {_scalar_text(value, LATER_ROW)}"
    statements = [child for child in value.children if child.is_named]
    inside = only_call(statements[0]) if value.type == "parenthesized_expression" and len(statements) == 1 else None
    if inside is None:
        raise _OtherForm(value, f"{text_of(value)[:40]} is no literal")
    return f"-{name} ({_call_text(inside, _VALUES)})"
