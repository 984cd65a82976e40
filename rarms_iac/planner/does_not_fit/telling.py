"""Why there is no layout as findings, with what would fit."""

from collections.abc import Iterator, Mapping, Sequence

from rarms_iac.model.diagnostics import Diagnostic, Place, Places
from rarms_iac.model.layout import Cause, Infeasible, Relaxation
from rarms_iac.model.where import partition_place
from rarms_iac.planner import findings
from rarms_iac.planner.problem import Problem

_SEARCHED = {
    findings.RESERVATIONS.code: False,
    findings.MEMORY.code: False,
    findings.PACKING.code: True,
    findings.PLACEMENT.code: True,
}
"""Causes that a certificate can be of; and whether they take a search, where a sum shows the others."""


def told(answer: Infeasible, problem: Problem, places: Places) -> Iterator[Diagnostic]:
    """The causes as findings; the ways out stand in each that they are for."""
    ways = answer.relaxations
    for cause in answer.causes:
        finding = findings.KINDS[cause.code]
        advice = _advice(cause, ways)
        says = cause.says
        yield finding.at(_place(cause, problem, places), f"{says}{_sure(answer, cause)}", advice, address=cause.what)


def _sure(answer: Infeasible, cause: Cause) -> str:
    """How sure it is that there is no placement."""
    if cause.code not in _SEARCHED:
        return ""
    if not answer.proven:
        return " It is not proven that there is none: the search gave up before it had tried everything."
    if answer.certificate:
        return " This is certified."
    return " This is proved by search, not certified." if _SEARCHED[cause.code] else ""


def _advice(cause: Cause, ways: Sequence[Relaxation]) -> str:
    usual: Mapping[str, str] = {
        findings.UNMEASURED.code: "Fix it with `cpu: { reserve: ... }`, or measure it first.",
        findings.PARALLELISM.code: "Give the partition or the component more `processors`, or lower the reserve.",
        findings.TOO_WIDE.code: "Lower `processors`, or name a larger host.",
        findings.COMPANY.code: "Change `partitions`, or take the rule out.",
    }
    if cause.advice:
        return cause.advice
    if cause.code in usual:
        return usual[cause.code]
    if not ways:
        return "No change that was tried makes it fit: remove a component, or add a host."
    sure = [one.says for one in ways if not one.may]
    told = [f"This would fit: {sure[0]}."] if len(sure) == 1 else []
    if len(sure) > 1:
        told = ["\n- ".join(["Each of these alone would fit:", *sure])]
    told += [f"{one.says[0].upper()}{one.says[1:]}." for one in ways if one.may]
    return "\n".join(told)


def _place(cause: Cause, problem: Problem, places: Places) -> Place:
    kind, _, name = cause.what.partition("/")
    match kind:
        case "host":
            last = "memory" if cause.code == findings.MEMORY.code else "logical_processors"
            return places.value("hosts", name, last)
        case "component":
            return places.key("components", name)
        case "partition":
            return partition_place(problem.system, places, name)
        case _:
            return places.key("application")
