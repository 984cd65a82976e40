"""A host's plan as scripts: what a reviewer reads, an operator can run, and `rarms apply` runs.

One script an operating system: the host's own, and one for each guest whose task classes the plan writes.
"""

import hashlib
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from math import floor

from rarms_iac.model.capacity import capacity_of
from rarms_iac.model.changes import Address
from rarms_iac.model.journal import RunKind
from rarms_iac.model.operations import CreatePartition, RemovePartition
from rarms_iac.model.plan import HostPlan, Plan, Readings, Scope, Step, UndoLevel
from rarms_iac.powershell.calls import ScriptPiece, creation_undo_pieces, fits, pieces_of
from rarms_iac.powershell.guests import GuestTask, back, forward
from rarms_iac.powershell.literals import Literal, literal, literals
from rarms_iac.powershell.templates import as_script, fill, part_text, parts_for, read, remark, runtime

_HOST_REQUIRES = ("-Modules Hyper-V", "-RunAsAdministrator")
_GUEST_REQUIRES = ("-RunAsAdministrator",)

_TITLES = {
    RunKind.APPLY: "rarms apply script.",
    RunKind.UNDO: "rarms undo script: it takes back what the apply script of the same plan did.",
}

NOT_UNDONE = "Not undone"
"""Begins the lines of a head that say what cannot be taken back."""


@dataclass(frozen=True, slots=True, kw_only=True)
class _NumberedPiece:
    """A guarded piece with its place in the script.

    `undoes`: the number of the apply script's step that it takes back; `lost`: of the one that removes its machine.
    """

    number: int
    piece: ScriptPiece
    step: Step
    undoes: int | None
    lost: int | None = None


def script_name(host_plan: HostPlan, inside: str = "", *, undo: bool = False) -> str:
    """`onboard.ps1`, `onboard.guest.vision.ps1`, `onboard.undo.ps1`."""
    guest = f".guest.{inside}" if inside else ""
    return f"{host_plan.host.name}{guest}{'.undo' if undo else ''}.ps1"


def insides(host_plan: HostPlan) -> tuple[str, ...]:
    """The operating systems that a plan changes: empty for the host itself, then partitions by name."""
    return tuple(sorted({_inside(step) for step in host_plan.steps} | {""}))


def render_scripts(host_plan: HostPlan, plan: Plan, *, accept_scheduler: bool = False) -> Mapping[str, bytes]:
    """Every script of a host by its file name, undo scripts included.

    Raises:
        NoLiteral: a value cannot be written into a script.
    """
    made: dict[str, bytes] = {}
    for inside in insides(host_plan):
        accept = accept_scheduler and not inside
        made[script_name(host_plan, inside)] = render_apply(host_plan, plan, inside, accept_scheduler=accept)
        made[script_name(host_plan, inside, undo=True)] = render_undo(host_plan, plan, inside, accept_scheduler=accept)
    return made


def render_apply(host_plan: HostPlan, plan: Plan, inside: str = "", *, accept_scheduler: bool = False) -> bytes:
    """The script that does the plan's steps in one operating system: the host's own, or a partition's guest.

    With `accept_scheduler` it runs also under the root scheduler: the finding was accepted.

    Raises:
        NoLiteral: a value cannot be written into a script.
    """
    undo = render_undo(host_plan, plan, inside, accept_scheduler=accept_scheduler)
    steps = [
        _NumberedPiece(number=number, piece=piece, step=step, undoes=None)
        for number, (piece, step) in enumerate(_forward(host_plan, plan, inside))
    ]
    run = {
        "undo": literal(script_name(host_plan, inside, undo=True)),
        "undo_digest": literal(hashlib.sha256(undo).hexdigest()),
        "accept_scheduler": literal(accept_scheduler),
    }
    return _fill(RunKind.APPLY, host_plan, plan, inside, steps, run)


def render_undo(host_plan: HostPlan, plan: Plan, inside: str = "", *, accept_scheduler: bool = False) -> bytes:
    """The script that takes the same steps back, the last one first; it says what it cannot bring back.

    Raises:
        NoLiteral: a value cannot be written into a script.
    """
    first: dict[int, tuple[int, Step]] = {}  # of each step its first part: what comes after goes with it
    for number, (_, step) in enumerate(_forward(host_plan, plan, inside)):
        first.setdefault(id(step), (number, step))
    steps: list[_NumberedPiece] = []
    lost: dict[Address, int] = {}  # what was done to a machine before it was removed went with it
    for undoes, step in reversed(first.values()):
        if isinstance(step.operation, RemovePartition):
            lost[step.address] = undoes
        if step.undo.operation is None:
            continue
        back = step.reversed(f"undo: {step.title}")
        if isinstance(step.operation, CreatePartition):
            pieces = creation_undo_pieces(back, step.operation, _scope(plan))
        else:
            pieces = pieces_of(back, _scope(plan))
        for piece in pieces:
            gone = lost.get(step.address)
            steps.append(_NumberedPiece(number=len(steps), piece=piece, step=back, undoes=undoes, lost=gone))
    run = {"undo": literal(""), "undo_digest": literal(""), "accept_scheduler": literal(accept_scheduler)}
    return _fill(RunKind.UNDO, host_plan, plan, inside, steps, run)


def render_guest(host_plan: HostPlan, plan: Plan, inside: str, tasks: Sequence[GuestTask]) -> Mapping[str, bytes]:
    """The script of a guest that could not be looked into, and its undo, by file name.

    Raises:
        NoLiteral: a value cannot be written into a script.
    """
    name, undo_name = script_name(host_plan, inside), script_name(host_plan, inside, undo=True)
    last = len(tasks) - 1
    pieces = [
        _NumberedPiece(number=at, piece=forward(task), step=task.step, undoes=None) for at, task in enumerate(tasks)
    ]
    taken_back = [
        _NumberedPiece(number=at, piece=back(task), step=task.step, undoes=last - at)
        for at, task in enumerate(reversed(tasks))
    ]
    never = {"accept_scheduler": literal(False)}
    bare = {"undo": literal(""), "undo_digest": literal(""), **never}
    undo = _fill(RunKind.UNDO, host_plan, plan, inside, taken_back, bare)
    run = {"undo": literal(undo_name), "undo_digest": literal(hashlib.sha256(undo).hexdigest()), **never}
    return {name: _fill(RunKind.APPLY, host_plan, plan, inside, pieces, run), undo_name: undo}


def render_observe() -> bytes:
    """The read-only script that prints what a host looks like as one JSON document."""
    return as_script(read("observe.ps1"))


def _scope(plan: Plan) -> Scope:
    return Scope(application=plan.application, plan=plan.id)


def _inside(step: Step) -> str:
    return step.address.partition if step.address.task else ""


def _forward(host_plan: HostPlan, plan: Plan, inside: str) -> list[tuple[ScriptPiece, Step]]:
    chosen = [step for step in host_plan.steps if _inside(step) == inside]
    return [(piece, step) for step in chosen for piece in pieces_of(step, _scope(plan))]


def _fill(
    kind: RunKind,
    host_plan: HostPlan,
    plan: Plan,
    inside: str,
    steps: Sequence[_NumberedPiece],
    more: Mapping[str, Literal],
) -> bytes:
    run = {"kind": literal(kind.value), "total": literal(len(steps)), **_run(host_plan, plan), **more}
    run |= {
        "guest": literal(_machine_of_guest(host_plan, inside, steps)),
        "guard": "Assert-Guest" if inside else "Assert-VmHost",
    }
    parts = parts_for("\n".join([run["guard"], *map(_code, steps)]))
    values = {
        "requirements": _GUEST_REQUIRES if inside else _HOST_REQUIRES,
        "title": _TITLES[kind],
        "header": _header(host_plan, plan, inside, steps, parts),
        "fixed": [runtime(), *map(part_text, parts)],
        "run": run,
        "steps": [_template_step(step, len(steps)) for step in steps],
    }
    return fill("script.ps1.j2", values)


def _machine_of_guest(host_plan: HostPlan, inside: str, steps: Iterable[_NumberedPiece]) -> str:
    """The id of the machine that a guest's script is for, or its name where the plan makes it; empty for the host's."""
    made = {step.address.partition for step in host_plan.steps if isinstance(step.operation, CreatePartition)}
    ids = (step.step.address.machine.lower() for step in steps)
    return inside if not inside or inside in made else next(filter(None, ids), inside)


def _run(host_plan: HostPlan, plan: Plan) -> dict[str, str]:
    """The facts of the run that a script and its undo have in common."""
    host, facts = host_plan.host, host_plan.facts
    capacity = capacity_of(host, facts)
    return {
        "plan": literal(plan.id),
        "application": literal(plan.application),
        "serial": literal(host_plan.serial),
        "computer": literal(facts.computer_name),
        "logical_processors": literal(facts.logical_processors),
        "cores": literal(capacity.cores),
        "threads_per_core": literal(capacity.sharing.threads),
        "percent": literal(max(0, floor(100 * capacity.processors))),
        "memory": literal(capacity.memory),
    }


def _header(
    host_plan: HostPlan, plan: Plan, inside: str, steps: Sequence[_NumberedPiece], parts: Sequence[str]
) -> list[str]:
    system = f"the guest of partition {inside}" if inside else "the host itself"
    lines = {
        "Application": f"{plan.application}, host {host_plan.host.name}: {system}",
        "Plan": f"{plan.id}, manifest {plan.manifest_digest[:12]}, rarms {plan.rarms_version}",
        "Steps": str(len(steps)),
        "Parts": f"{', '.join(parts)}: what the runtime and these steps call",
    }
    lost = sorted({step.step.undo.message for step in steps if step.step.undo.level is not UndoLevel.FULL})
    return [f"{name:<12} {remark(text)}" for name, text in lines.items()] + [
        f"{NOT_UNDONE:<12} {remark(text)}" for text in lost
    ]


def _template_step(numbered: _NumberedPiece, total: int) -> dict[str, object]:
    """A step as its template takes it: literals and remarks."""
    piece = numbered.piece
    return {
        "number": literal(numbered.number),
        "address": literal(piece.address),
        "action": literal(_one_line(piece.action)),
        "needs": literals(_needs(piece.address)),
        "extra": tuple(_extra(numbered)),
        "read": piece.read,
        "before": _table(piece.before),
        "after": _table(piece.after),
        "calls": piece.calls,
        "remarks": tuple(_remarks(numbered, total)),
    }


def _code(numbered: _NumberedPiece) -> str:
    """All of a step that calls anything."""
    extra = (value for _, value in _extra(numbered))
    return "\n".join([numbered.piece.read, *numbered.piece.calls, *extra])


def _one_line(text: str) -> str:
    """A title on one line, whatever names it shows."""
    return remark(text)


def _needs(address: str) -> tuple[str, ...]:
    """The addresses that a step builds on: its own, and that of the machine that it is inside of."""
    parts = address.split("/")
    return tuple("/".join(parts[:length]) for length in range(2, len(parts) + 1) if length != 3 or len(parts) == 3)


def _extra(numbered: _NumberedPiece) -> Iterable[tuple[str, Literal]]:
    if numbered.undoes is not None:
        yield "Undoes", literal(numbered.undoes)
    if numbered.lost is not None:
        yield "Lost", literal(numbered.lost)
    if numbered.step.claim_before.is_less_than(numbered.step.claim_after):
        yield "Fits", "{ " + fits(numbered.step) + " }"


def _table(readings: Readings) -> str:
    """In lower case, as the script reads them: 5.1 compares keys by culture, and to a Turkish one I and i differ."""
    return "; ".join(f"{literal(name.lower())} = {literal(value)}" for name, value in sorted(readings.items()))


def _remarks(numbered: _NumberedPiece, total: int) -> Iterable[str]:
    step = numbered.step
    yield f"{numbered.number + 1}/{total}  {remark(numbered.piece.address)}: {remark(numbered.piece.action)}"
    if step.comment:
        yield f"why: {remark(step.comment)}"
    if step.place:
        yield f"at:  {remark(str(step.place))}"
    if step.undo.message:
        yield f"undo: {remark(step.undo.message)}"
