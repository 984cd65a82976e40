"""What a run does on a host, as scripts: what a reviewer reads, an operator can run, and `rarms apply` runs.

One script an operating system: the host's own, and one for each guest whose task classes the run writes.
"""

import hashlib
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, replace
from itertools import groupby
from math import floor

from rarms_iac.model.capacity import capacity_of
from rarms_iac.model.changes import Address
from rarms_iac.model.facets import Readings
from rarms_iac.model.host import ProviderKind, SchedulerType
from rarms_iac.model.journal import RunKind
from rarms_iac.model.operations import CreatePartition, RemovePartition, RestorePartition, StartPartition, StopPartition
from rarms_iac.model.plan import GuestTask, HostSteps, RunIdentity, Step, owner_of
from rarms_iac.model.state import Partition, Tie
from rarms_iac.powershell.guests import back, forward, step_of
from rarms_iac.powershell.literals import Literal, literal
from rarms_iac.powershell.pieces import (
    NewFiles,
    ScriptPiece,
    block_of,
    capacity_call,
    cluster_piece,
    clustered,
    creation_undo_pieces,
    join_pieces,
    pieces_of,
)
from rarms_iac.powershell.rows import PlanBlock, plan_lines
from rarms_iac.powershell.summary import (
    change_table,
    duration_line,
    foreign_lines,
    machine_table,
    not_undone_lines,
    summary_lines,
)
from rarms_iac.powershell.templates import (
    ENTRY,
    HOST_FACT_NAMES,
    ScriptForm,
    StepText,
    TargetText,
    fact_lines,
    fill,
    impact_of,
    module_digests,
    module_section,
    module_text,
)
from rarms_iac.storage.marks import foreign_values
from rarms_iac.texts.messages import remark
from rarms_iac.texts.plans import describe_stop, reversal_title

_HOST_REQUIRES = ("-Modules Hyper-V", "-RunAsAdministrator")
_GUEST_REQUIRES = ("-RunAsAdministrator",)

_TITLES = {
    RunKind.APPLY: "rarms apply script",
    RunKind.UNDO: "rarms undo script",
}


@dataclass(frozen=True, slots=True, kw_only=True)
class _GuardedPiece:
    """A step of a script: what it does, and the steps of the run that it stands for, at least one.

    `undoes`: the number of the apply script's step that it undoes; `lost`: of the one that removes its machine.
    """

    piece: ScriptPiece
    steps: tuple[Step, ...]
    undoes: int | None = None
    lost: int | None = None
    is_added: bool = False  # the plan has no step for it: it goes with the one that it names


@dataclass(frozen=True, slots=True, kw_only=True)
class _Target:
    """One operating system of a host, which has a script and an undo script."""

    on: HostSteps
    run: RunIdentity
    inside: str  # a partition, for its guest; empty: the host's own

    def name(self, *, undo: bool = False) -> str:
        return script_name(self.on, self.inside, undo=undo)

    @property
    def steps(self) -> list[Step]:
        return [step for step in self.on.steps if _inside(step) == self.inside]

    @property
    def unseen_tasks(self) -> list[GuestTask]:
        """Return the task classes of a guest that could not be observed."""
        return [task for task in self.on.guest_tasks or () if task.partition == self.inside]

    @property
    def files(self) -> NewFiles:
        return NewFiles(plan=self.run.id, disk_folder=self.on.facts.disk_folder)


def script_name(on: HostSteps, inside: str = "", *, undo: bool = False) -> str:
    """Return `onboard.ps1`, `onboard.guest.vision.ps1` or `onboard.undo.ps1`."""
    guest = f".guest.{inside}" if inside else ""
    return f"{on.host.name}{guest}{'.undo' if undo else ''}.ps1"


def insides(on: HostSteps) -> tuple[str, ...]:
    """Return the systems that a run changes: empty for the host itself, then partitions by name for their guests."""
    unseen = {task.partition for task in on.guest_tasks or ()}
    return tuple(sorted({_inside(step) for step in on.steps} | unseen))


def render_scripts(on: HostSteps, run: RunIdentity, form: ScriptForm = ScriptForm.MODULE) -> Mapping[str, bytes]:
    """Return the scripts of a host by file name, each with its undo script.

    A plan exists on a host with the root scheduler where that was accepted or no reserve is wanted: they run there.

    Raises:
        NoLiteral: a value cannot be written into a script.
    """
    scripts: dict[str, bytes] = {}
    for inside in insides(on):
        target = _Target(on=on, run=run, inside=inside)
        undo = _fill(target, _steps_back(target), form)
        scripts |= {target.name(): _fill(target, _steps_there(target), form, undo), target.name(undo=True): undo}
    return dict(sorted(scripts.items()))


def script_steps(on: HostSteps, run: RunIdentity, inside: str, *, undo: bool) -> tuple[ScriptPiece, ...]:
    """Return the steps of one of a host's scripts, in their order.

    Raises:
        NoLiteral: a value cannot be written into a script.
    """
    target = _Target(on=on, run=run, inside=inside)
    return tuple(guarded.piece for guarded in (_steps_back if undo else _steps_there)(target))


def _steps_there(target: _Target) -> list[_GuardedPiece]:
    if tasks := target.unseen_tasks:
        application = target.run.application
        return [_GuardedPiece(piece=forward(task, application), steps=(step_of(task),)) for task in tasks]
    return _forward(target)


def _steps_back(target: _Target) -> list[_GuardedPiece]:
    """Return the steps that undo those of the run, the last one first."""
    if tasks := target.unseen_tasks:
        return [
            _GuardedPiece(piece=piece, steps=(replace(step_of(task), title=piece.action),), undoes=undoes)
            for undoes, task in reversed([*enumerate(tasks)])
            for piece in [back(task, target.run.application)]
        ]
    first: dict[int, tuple[int, Step]] = {}  # of each step its first part: what comes after goes with it
    for number, done in enumerate(_forward(target)):
        for step in done.steps:
            first.setdefault(id(step), (number, step))
    changes = target.on.changes_by_address
    steps: list[_GuardedPiece] = []
    lost: dict[Address, int] = {}  # what was done to a machine before it was removed went with it
    for undoes, step in reversed(first.values()):
        if isinstance(step.operation, RemovePartition):
            lost[step.address] = undoes
        if step.undo.operation is None or isinstance(step.undo.operation, RestorePartition):
            continue
        title = reversal_title(step, changes)
        if isinstance(step.undo.operation, StopPartition):
            title += f" ({describe_stop(step.undo.operation.grace_ms, ProviderKind.HYPERV)})"
        reversed_step = step.reversed(title)
        if isinstance(step.operation, CreatePartition):
            pieces = creation_undo_pieces(reversed_step, step.operation, target.files)
        else:
            pieces = pieces_of(reversed_step, target.files)
        gone = lost.get(step.address)
        steps += (_GuardedPiece(piece=piece, steps=(reversed_step,), undoes=undoes, lost=gone) for piece in pieces)
    return _clustered(_joined(steps), target.on)


def render_observe() -> bytes:
    """Return the read-only script that prints the state of a host as one JSON document."""
    return fill("observe.ps1.j2", {"shared": module_section("shared")})


def _inside(step: Step) -> str:
    return step.address.partition if step.address.task else ""


def _forward(target: _Target) -> list[_GuardedPiece]:
    pieces = (
        _GuardedPiece(piece=piece, steps=(step,)) for step in target.steps for piece in pieces_of(step, target.files)
    )
    return _clustered(_joined(pieces), target.on)


def _clustered(steps: Sequence[_GuardedPiece], on: HostSteps) -> list[_GuardedPiece]:
    """Return the steps; behind the last one of a failover cluster's machine the cluster is updated."""
    machines = {
        change.address.machine.lower()
        for change in on.changes
        if isinstance(change.before, Partition) and Tie.CLUSTER in change.before.ties
    }
    last = {step.piece.address: at for at, step in enumerate(steps)}
    made: list[_GuardedPiece] = []
    for at, step in enumerate(steps):
        machine = step.steps[0].address.machine.lower()
        if machine not in machines:
            made.append(step)
            continue
        made.append(replace(step, piece=clustered(step.piece)))
        if at == last[step.piece.address]:
            update = cluster_piece(step.piece.address, machine)
            made.append(_GuardedPiece(piece=update, steps=step.steps[-1:], is_added=True))
    return made


def _joined(pieces: Iterable[_GuardedPiece]) -> list[_GuardedPiece]:
    """Join neighbours that can be done as one step."""
    steps: list[_GuardedPiece] = []
    for new in pieces:
        old = steps[-1] if steps else new
        if old is not new and _can_join(old, new):
            steps[-1] = replace(old, piece=join_pieces(old.piece, new.piece), steps=old.steps + new.steps)
        else:
            steps.append(new)
    return steps


def _can_join(old: _GuardedPiece, new: _GuardedPiece) -> bool:
    same = (old.piece.address, old.undoes) == (new.piece.address, new.undoes)
    return same and old.piece.joins and new.piece.joins


def _fill(target: _Target, steps: Sequence[_GuardedPiece], form: ScriptForm, undo: bytes = b"") -> bytes:
    """Return the script of these steps; `undo` is the one that undoes them, empty for an undo script."""
    on, inside, kind = target.on, target.inside, RunKind.APPLY if undo else RunKind.UNDO
    undo_digest = hashlib.sha256(undo).hexdigest() if undo else ""
    run = {
        "Run": literal(kind.value),
        "Guest": literal(_machine_of_guest(target, steps)),
        "Undo": literal(target.name(undo=True) if undo else ""),
        "UndoDigest": literal(undo_digest),
        "AcceptScheduler": literal(on.facts.scheduler is SchedulerType.ROOT),
        **_run(target),
    }
    if inside or not undo:  # neither asks what the host has to give
        run = {name: value for name, value in run.items() if name not in HOST_FACT_NAMES}
    digests = f"SHA-256: {f'the undo {undo_digest}, ' if undo else ''}Rarms.psm1 {module_digests()['Rarms.psm1']}."
    values = {
        "requirements": _GUEST_REQUIRES if inside else _HOST_REQUIRES,
        "name": target.name(undo=not undo),
        **_head(kind, target, steps, digests),
        "facts": fact_lines(run),
        "entry": ENTRY,
        "impact": impact_of(call for step in steps for call in step.piece.calls),
        "plan": list(plan_lines(_blocks(kind, on, steps))),
        "unasked": () if form is ScriptForm.MODULE else ("Test-Wanted asks once before each step.",),
        "module": module_text(form),
    }
    return fill("script.ps1.j2", values)


def _machine_of_guest(target: _Target, steps: Iterable[_GuardedPiece]) -> str:
    """Return the id of a guest script's machine, or its name if the plan makes it; empty for the host."""
    made = {step.address.partition for step in target.on.steps if isinstance(step.operation, CreatePartition)}
    ids = (step.steps[0].address.machine.lower() for step in steps)
    inside = target.inside
    return inside if not inside or inside in made else next(filter(None, ids), inside)


def _run(target: _Target) -> dict[str, str]:
    """Return the facts of the run that a script and its undo have in common."""
    run, facts = target.run, target.on.facts
    capacity = capacity_of(target.on.host, facts)
    return {
        "Purpose": literal(run.purpose.value),
        "Plan": literal(run.id),
        "Application": literal(run.application),
        "Robot": literal(run.robot),
        "Serial": literal(target.on.serial),
        "Identity": literal(facts.id),
        "Computer": literal(facts.computer_name),
        "LogicalProcessors": literal(facts.logical_processors),
        "Cores": literal(capacity.cores),
        "ThreadsPerCore": literal(capacity.sharing.threads),
        "Percent": literal(max(0, floor(100 * capacity.processors))),
        "Memory": literal(capacity.memory),
    }


def _head(kind: RunKind, target: _Target, steps: Sequence[_GuardedPiece], digests: str) -> dict[str, object]:
    """Return the help that `Get-Help` shows of the script."""
    on, run, inside = target.on, target.run, target.inside
    system = f"the guest of partition {inside} on " if inside else ""
    if on.facts.provider is ProviderKind.SIMULATED:
        system += "the simulated "  # its script can be read, and fits no computer
    system += f"host {on.host.name} of {run.manifest}, computer {on.facts.computer_name}"
    undo = target.name(undo=True)
    planned = [step for guarded in steps if not guarded.is_added for step in guarded.steps]
    table = machine_table(planned, on.changes, target.files)
    made = {step.address for step in planned if isinstance(step.operation, CreatePartition)}
    lost = {owner_of(step) for guarded in steps if guarded.lost is not None for step in guarded.steps}
    others = change_table((step for step in planned if not table or step.address not in made), lost)
    # An undo has no step for what it cannot bring back, and says so all the same.
    changed = target.steps or planned
    risk, calls = summary_lines([guarded.piece for guarded in steps]) if steps else ("", "")
    return {
        "synopsis": _help(f"{_TITLES[kind]}: plan {run.id} of application {run.application}, for {system}."),
        "description": [
            *filter(None, (risk,)),
            *map(_inside_help, table),
            *map(_inside_help, others),
            *((duration_line(planned), calls) if steps else ()),
            *map(_help, not_undone_lines(changed)),
            *map(_help, _foreign_lines(on, planned) if kind is RunKind.UNDO else ()),
        ],
        "usage": (f"Shows the changes. Without -WhatIf, makes them. To undo them, run .\\{undo} in the same folder.")
        if kind is RunKind.APPLY
        else "Shows the changes. Without -WhatIf, undoes the completed steps, the last one first.",
        "notes": [
            _help(f"Manifest {run.manifest_digest[:12]}, rarms {run.rarms_version}. {digests}"),
            *(_help(f"Accepted: {finding.code} {finding.summary}, {finding.detail}") for finding in run.accepted),
        ],
    }


def _foreign_lines(on: HostSteps, steps: Iterable[Step]) -> tuple[str, ...]:
    changes = on.changes_by_address
    undone = dict.fromkeys(step.address for step in steps)
    return foreign_lines(foreign_values(changes[address] for address in undone if address in changes))


def _help(text: str) -> str:
    """Return a line of the help, in which nothing ends the help."""
    return _inside_help(remark(text))


def _inside_help(text: str) -> str:
    """Return a line that is a remark already, in which nothing ends the help."""
    return text.replace("#>", "# >")


def _blocks(kind: RunKind, on: HostSteps, steps: Sequence[_GuardedPiece]) -> Iterable[PlanBlock]:
    """Return the steps of each partition or task class as blocks; the first block and a start have a reason."""
    reasons = {str(change.address): change.reason.message for change in on.changes}
    owners: set[str] = set()
    for owner, neighbours in groupby(steps, key=_block_owner):
        pieces = list(neighbours)
        first = pieces[0].steps[0]
        reason = ""
        if owner[0] not in owners:
            reason = reasons.get(str(first.address)) or first.comment
            if kind is RunKind.UNDO:
                reason = "undoes the steps of the apply script, the last one first"
        elif owner[1]:
            reason = pieces[0].piece.action  # starts come last, behind the steps of other partitions
        yield PlanBlock(
            owner=owner[0],
            reason=reason,
            action=pieces[0].piece.action,
            place=str(first.place) if first.place else "",
            is_first=owner[0] not in owners,
            statements=tuple(_statements(pieces)),
        )
        owners.add(owner[0])


def _block_owner(guarded: _GuardedPiece) -> tuple[str, bool]:
    """Return the subject of its block, and whether the block is a start."""
    step = guarded.steps[0]
    return owner_of(step), isinstance(step.operation, StartPartition)


def _statements(pieces: Sequence[_GuardedPiece]) -> Iterable[TargetText | StepText]:
    target: TargetText | None = None
    for guarded in pieces:
        piece = guarded.piece
        new = TargetText(address=literal(piece.address), reading=piece.read)
        if target != new:
            target = new
            yield target
        yield _step_text(guarded)


def _step_text(guarded: _GuardedPiece) -> StepText:
    piece = guarded.piece
    before, after = (_literals(readings) for readings in _without_implied(piece.before, piece.after))
    same = {name: value for name, value in before.items() if after.get(name) == value}
    return StepText(
        action=literal(remark(piece.action)),
        same=same,
        before={name: value for name, value in before.items() if name not in same},
        after={name: value for name, value in after.items() if name not in same},
        calls=block_of(piece),
        options=tuple(_options(guarded)),
    )


def _without_implied(before: Readings, after: Readings) -> tuple[Readings, Readings]:
    """Drop readings that others imply: `running` with `state`, and `exists` if it stays true."""
    implied = {"running"} if "state" in before and "state" in after else set()
    if before.get("exists") is True and after.get("exists") is True:
        implied.add("exists")
    tables = [
        {name: value for name, value in readings.items() if name not in implied or len(readings) == 1}
        for readings in (before, after)
    ]
    return tables[0], tables[1]


def _options(guarded: _GuardedPiece) -> Iterable[tuple[str, Literal]]:
    first, last = guarded.steps[0], guarded.steps[-1]
    if guarded.undoes is not None:
        yield "Undoes", literal(guarded.undoes)
    if guarded.lost is not None:
        yield "Lost", literal(guarded.lost)
    if guarded.undoes is None and not guarded.is_added and first.claim_before.is_less_than(last.claim_after):
        yield "Fits", "{ " + capacity_call(last) + " }"


def _literals(readings: Readings) -> dict[str, Literal]:
    """Return names in lower case with literals: 5.1 compares keys by culture, and in Turkish I and i differ."""
    names = {name.lower(): literal(value) for name, value in sorted(readings.items())}
    return {name if name.isidentifier() else literal(name): value for name, value in names.items()}
