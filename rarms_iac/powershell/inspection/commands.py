"""Which commands scripts may call, and whether each call binds in 5.1 and 7 alike."""

from collections.abc import Iterator

from rarms_iac.model.diagnostics import Diagnostic, Finding
from rarms_iac.powershell import cmdlets
from rarms_iac.powershell.cmdlets import Cmdlet, problems_of_call
from rarms_iac.powershell.inspection.allowed import CHANGING, ScriptKind
from rarms_iac.powershell.inspection.script import CommandCall, Function, Script, calls_of
from rarms_iac.powershell.literals import NotALiteral, read_literal
from rarms_iac.powershell.tokens import NotTokens
from rarms_iac.powershell.tree import text_of

COMMAND = Finding.error("RARMS204", "A script calls a command that is not allowed")
CALL = Finding.error("RARMS205", "A call in a script would not bind")
WRITES = Finding.error("RARMS210", "A read-only script changes something")
FORCE = Finding.error("RARMS218", "A registry key would be emptied")

HYPERV = "Hyper-V"


def check_commands(script: Script) -> Iterator[Diagnostic]:
    """Each call: a function of the script, or a cmdlet of the lists under its full name, with parameters that fit."""
    for call in calls_of(script.root):
        if call.name:
            yield from _check_call(script, call)


def _check_call(script: Script, call: CommandCall) -> Iterator[Diagnostic]:
    if call.operator:
        detail = f"& before {call.name}: a cmdlet is called by its name alone"
        yield script.problem(COMMAND, call.node, detail, "leave out the &")
    if function := script.functions.get(call.name.lower()) or script.given.get(call.name.lower()):
        yield from _check_function_call(script, call, function)
        return
    module, _, name = call.name.rpartition("\\")
    cmdlet = cmdlets.cmdlet(name, module)
    allowed = script.lists.qualified if module else script.lists.plain
    if cmdlet is None or cmdlet.name != name or not cmdlet.in_7:
        yield script.problem(COMMAND, call.node, f"{call.name} is no cmdlet of 5.1 and 7 that rarms knows", _ADVICE)
    elif name not in allowed or (bool(module) and module != HYPERV):
        yield from _not_allowed(script, call, cmdlet)
    else:
        yield from _check_binding(script, call, cmdlet)


_ADVICE = "call a cmdlet of the tables by its full name, with its module where that is Hyper-V"


def _not_allowed(script: Script, call: CommandCall, cmdlet: Cmdlet) -> Iterator[Diagnostic]:
    changes = cmdlet.name in CHANGING.qualified | CHANGING.plain or cmdlet.should_process
    if script.kind is ScriptKind.OBSERVE and changes:
        detail = f"{call.name} does not only read"
        yield script.problem(WRITES, call.node, detail, "a read-only script calls Get- and Test- cmdlets")
    elif cmdlet.module == HYPERV and "\\" not in call.name:
        detail = f"{call.name} may be another module's"
        yield script.problem(COMMAND, call.node, detail, f"write {HYPERV}\\{cmdlet.name}")
    else:
        yield script.problem(COMMAND, call.node, f"scripts of rarms have no need of {call.name}", _ADVICE)


def _check_function_call(script: Script, call: CommandCall, function: Function) -> Iterator[Diagnostic]:
    if call.name != function.name:
        detail = f"{call.name} is written {function.name}"
        yield script.problem(CALL, call.node, detail, "write it as it is defined")
    names = [given.name for given in call.given]
    for given in call.given:
        if given.name not in function.parameters:
            detail = f"{function.name} has no parameter -{given.name}"
            yield script.problem(CALL, given.node, detail, "see the function's param block")
        elif (given.value is None) != function.parameters[given.name]:
            yield script.problem(CALL, given.node, f"-{given.name} lacks a value, or takes none", "see the param block")
    if len(set(names)) != len(names) or call.loose:
        yield script.problem(CALL, call.node, f"{function.name} gets a value without a name, or one twice", "name each")


def _check_binding(script: Script, call: CommandCall, cmdlet: Cmdlet) -> Iterator[Diagnostic]:
    names, loose = [given.name for given in call.given], len(call.loose)
    for given in call.given:
        parameter = cmdlet.parameter(given.name)
        if parameter is None:
            continue
        if parameter.is_switch and given.value is not None:
            loose += 1
        elif not parameter.is_switch and given.value is None:
            yield script.problem(CALL, given.node, f"-{given.name} of {cmdlet.name} needs a value", "give it one")
        elif given.value is not None and parameter.accepted and not _accepts(parameter.accepted, text_of(given.value)):
            detail = f"-{given.name} of {cmdlet.name} does not take {text_of(given.value)[:40]}"
            yield script.problem(CALL, given.node, detail, f"it takes {', '.join(parameter.accepted[:12])}")
    for problem in problems_of_call(cmdlet, names, positional=loose, piped=call.piped):
        yield script.problem(CALL, call.node, problem.message, problem.advice)
    if cmdlet.name == "New-Item" and "Force" in names:
        detail = "New-Item with -Force makes a key anew: what it held is lost"
        yield script.problem(FORCE, call.node, detail, "test for the key first, and create it without -Force")
    if cmdlet.name == "Remove-Item" and set(names) & {"Force", "Recurse"}:
        detail = "Remove-Item takes more than the one empty-handed key"
        yield script.problem(FORCE, call.node, detail, "remove one key, without -Recurse and -Force")


def _accepts(accepted: tuple[str, ...], text: str) -> bool:
    """Whether a literal is one of the accepted values; what is no literal cannot be told here."""
    try:
        return str(read_literal(text)) in accepted
    except (NotALiteral, NotTokens):
        return True
