"""A plan for a Linux host as a shell script that a person can review and run without rarms, and its undo. Pure.

The script does what `rarms apply` does: the same definitions, marks and journal, so that `rarms undo`, `rarms history`
and the next plan know its run like one of their own. Its fixed part lies in `templates/shell/runtime.sh`.
"""

import json
import shlex
from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from itertools import groupby
from pathlib import Path

from rarms_iac.model.host import LinuxHost
from rarms_iac.model.journal import RunKind
from rarms_iac.model.operations import (
    CreatePartition,
    EraseMark,
    Operation,
    RemovePartition,
    RenamePartition,
    SetActions,
    SetCpu,
    SetMemory,
    SetProcessors,
    StartPartition,
    StopPartition,
    WriteMark,
)
from rarms_iac.model.plan import (
    HostPlan,
    Plan,
    Reading,
    Readings,
    Scope,
    Step,
    UndoLevel,
    owner_of,
    partition_summaries,
)
from rarms_iac.model.wording import remark
from rarms_iac.providers.cgroups.content import new_definition, slice_limit, write_definition
from rarms_iac.storage.codec import encode
from rarms_iac.storage.shipped import shipped_text

WIDTH = 120
_NEVER = -1  # the number of no step


@dataclass(frozen=True, slots=True, kw_only=True)
class _ScriptStep:
    """A step with its number in the apply script.

    In an undo script `gone` is the number of the step that removed the partition later: where that was done, there is
    nothing to undo in this step.
    """

    number: int
    step: Step
    gone: int = _NEVER


def quote(text: str) -> str:
    """Return the text as a word of a shell, in ASCII; characters that are not printable are written by their bytes.

    Args:
        text: of any length; empty gives an empty word.

    Raises:
        ValueError: it holds a NUL or half a surrogate pair, which no word can.
    """
    if "\0" in text:
        raise ValueError("a word of a shell has no NUL")
    runs = ((plain, "".join(run)) for plain, run in groupby(text, key=_is_plain))
    return "".join(shlex.quote(run) if plain else _printed(run) for plain, run in runs) or "''"


def _is_plain(character: str) -> bool:
    return character == "\n" or (character.isascii() and character.isprintable())


def _printed(run: str) -> str:
    return "\"$(printf '" + "".join(f"\\{byte:03o}" for byte in run.encode()) + "')\""


def script_names(host: str) -> tuple[str, str]:
    """Return the file names of a host's apply script and of its undo script.

    Args:
        host: its name in the manifest.
    """
    return f"{host}.sh", f"{host}.undo.sh"


def render_shell_scripts(host_plan: HostPlan, plan: Plan, state_folder: Path) -> Mapping[str, str]:
    """Return the apply and the undo script of a Linux host by their file names; none where there is nothing to do.

    Args:
        host_plan: the part of the plan for this host.
        plan: the whole plan.
        state_folder: where definitions and journals of all slices lie.

    Raises:
        ValueError: a step does what control groups do not have.
    """
    if not host_plan.steps:
        return {}
    apply_steps = [_ScriptStep(number=number, step=step) for number, step in enumerate(host_plan.steps)]
    name, undo_name = script_names(host_plan.host.name)
    return {
        name: _render(RunKind.APPLY, host_plan, plan, apply_steps, state_folder),
        undo_name: _render(RunKind.UNDO, host_plan, plan, list(_undo_steps(host_plan.steps)), state_folder),
    }


def _undo_steps(steps: Sequence[Step]) -> Iterator[_ScriptStep]:
    """Yield the steps that take these back, the last first; see `_ScriptStep` on partitions that were removed."""
    gone: dict[str, int] = {}
    for number, step in reversed(list(enumerate(steps))):
        partition = step.address.partition
        if step.undo.operation is not None:
            reversed_step = step.reversed(str(step.undo.operation))
            yield _ScriptStep(number=number, step=reversed_step, gone=gone.get(partition, _NEVER))
        elif step.after.get("exists") is False:
            gone[partition] = number


def _render(kind: RunKind, host_plan: HostPlan, plan: Plan, steps: Sequence[_ScriptStep], state_folder: Path) -> str:
    from jinja2 import Environment, StrictUndefined

    environment = Environment(  # noqa: S701 - a shell is no HTML: what enters is quoted or a remark already
        undefined=StrictUndefined, trim_blocks=True, lstrip_blocks=True, keep_trailing_newline=True
    )
    settings = host_plan.host.settings
    slice_name, version = (
        (settings.slice, settings.control_groups) if isinstance(settings, LinuxHost) else ("rarms", "automatic")
    )
    facts = host_plan.facts
    before, after = _host_plan_record(host_plan) if kind is RunKind.APPLY else ("", "")
    return environment.from_string(shipped_text("templates/shell/script.sh.j2")).render(
        head=[f"# {line}".rstrip() for line in _head(kind, host_plan, plan, steps)],
        kind=kind.value,
        plan=plan.id,
        application=quote(plan.application),
        serial=host_plan.serial,
        host=quote(host_plan.host.name),
        computer=quote(facts.computer_name),
        processors=facts.logical_processors,
        memory=facts.memory,
        limit=slice_limit(host_plan.host, facts.logical_processors) or -1,
        folder=quote(str(state_folder / slice_name)),
        slice=quote(slice_name),
        control_groups=version,
        steps=list(_plan_lines(kind, host_plan, plan, steps)),
        runtime=shipped_text("templates/shell/runtime.sh").rstrip("\n"),
        template=_template(),
        records=[_json(numbered.step) for numbered in steps],
        record_before=before,
        record_after=after,
    )


def _head(kind: RunKind, host_plan: HostPlan, plan: Plan, steps: Sequence[_ScriptStep]) -> Iterator[str]:
    """Yield the head's lines: the plan, what changes, how it is run and taken back, and the exit codes."""
    name, undo_name = script_names(host_plan.host.name)
    own, lost = (name if kind is RunKind.APPLY else undo_name), []
    yield remark(f"rarms {kind.value} script: plan {plan.id} of application {plan.application}.")
    yield remark(f"Host {host_plan.host.name} of {plan.manifest}, computer {host_plan.facts.computer_name}.")
    yield ""
    yield from map(remark, partition_summaries(numbered.step for numbered in steps))
    for numbered in steps:
        undo = numbered.step.undo
        if undo.level is not UndoLevel.FULL and undo.message not in lost:
            lost.append(undo.message)
    yield from (f"Not undone: {remark(text)}" for text in lost)
    yield ""
    yield f"sh {own}                      do it; run again after a kill, it goes on where it stopped"
    yield f"sh {own} --what-if            only say what it would do"
    yield f"sh {own} --lock-timeout 60    wait so many seconds for another run to end"
    yield f"sh {own} --abandon            close this host's unfinished run and change nothing"
    yield f"sh {own} --boot               after each start of the machine: start all partitions that ran before"
    if kind is RunKind.APPLY:
        yield f"sh {undo_name}    take it back; so does rarms undo"
    yield ""
    yield "Exit code 0: done, or done already. 1: a call failed; run it again to go on."
    yield "3: the host is not as the plan saw it, another run holds it, or the plan was used. 64: wrong usage."
    yield remark(f"Manifest {plan.manifest_digest[:12]}, rarms {plan.rarms_version}.")


def _plan_lines(kind: RunKind, host_plan: HostPlan, plan: Plan, steps: Iterable[_ScriptStep]) -> Iterator[str]:
    """Yield the steps under a banner for each partition, with a `use` line where the partition changes."""
    reasons = {str(change.address): change.reason.message for change in host_plan.changes}
    ids = _ids(host_plan, plan)
    owners: set[str] = set()
    used = ""
    for numbered in steps:
        step = numbered.step
        owner = owner_of(step)
        if owner not in owners:
            owners.add(owner)
            reason = reasons.get(str(step.address)) or step.comment
            if kind is RunKind.UNDO:
                reason = "takes back what the apply script did to it, the last step first"
            yield ""
            yield f"    # === {remark(owner)} ".ljust(96, "=")
            yield f"    # {remark(f'{step.place}: {reason}' if step.place else reason)}"
        identity = step.address.machine or ids[step.address.partition]
        use = f"    use {quote(step.address.partition)} {quote(identity)}"
        if use != used:
            yield use
            used = use
        yield from _step_lines(numbered, plan)


def _ids(host_plan: HostPlan, plan: Plan) -> dict[str, str]:
    """Return the ids of the partitions that the plan makes, by name: the same that `rarms apply` gives them."""
    scope = Scope(application=plan.application, plan=plan.id)
    return {
        step.operation.partition: new_definition(
            step.operation, scope.pending(step.operation.partition), host_plan.facts.id, ()
        ).id
        for step in host_plan.steps
        if isinstance(step.operation, CreatePartition)
    }


def _step_lines(numbered: _ScriptStep, plan: Plan) -> Iterator[str]:
    """Yield a step on two lines, or on more where its parts are too long for one."""
    step = numbered.step
    gone = f" gone={numbered.gone}" if numbered.gone != _NEVER else ""
    yield f"    step {numbered.number} {quote(remark(step.title))}{gone} \\"
    parts = [
        " ".join(["before", *_words(step.before)]),
        " ".join(["after", *_words(step.after)]),
        " ".join(["set", *map(quote, _call(step.operation, plan))]),
    ]
    if len(whole := f"        {' '.join(parts)}") <= WIDTH:
        yield whole
    else:
        yield from (f"        {part} \\" for part in parts[:-1])
        yield f"        {parts[-1]}"


def _words(readings: Readings) -> list[str]:
    return [shlex.quote(f"{name}={_text(value)}") for name, value in readings.items()]


def _text(value: Reading) -> str:
    """Return a reading as the script's `reading` prints it: text as in JSON, which is ASCII without line ends."""
    match value:
        case bool():
            return "true" if value else "false"
        case str():
            return json.dumps(value)[1:-1]
        case int():
            return str(value)


def _call(operation: Operation, plan: Plan) -> list[str]:
    """Return the function of the runtime that does the operation, and its arguments."""
    match operation:
        case CreatePartition(partition=partition, memory=memory):
            pending = Scope(application=plan.application, plan=plan.id).pending(partition)
            return ["create_partition", pending, str(memory)]
        case RemovePartition():
            return ["remove_partition"]
        case RenamePartition(name=name):
            return ["rename_partition", _text(name)]
        case WriteMark(application=application, name=name, set=digest, stopped_by=stopped_by):
            return ["write_mark", f"{application}/{name}", f"{digest} {stopped_by.value}".rstrip()]
        case EraseMark():
            return ["erase_mark"]
        case SetProcessors(processors=processors):
            return ["set_processors", str(processors)]
        case SetCpu(reserve=reserve, limit=limit, weight=weight, quota_period_us=period):
            return ["set_cpu", str(reserve), str(limit), str(weight), "null" if period is None else str(period)]
        case SetMemory(memory=memory):
            return ["set_memory", str(memory)]
        case SetActions(start=start):
            return ["set_start", start.value] if start else ["true"]
        case StartPartition():
            return ["start_partition"]
        case StopPartition(grace_ms=grace):
            return ["stop_partition", str(-(-grace // 100))]
        case _:
            raise ValueError(f"a control group cannot do this: {operation}")


def _template() -> str:
    """Return the definition of a new partition, with placeholders for its id, name and memory."""
    making = CreatePartition(partition="@", generation=2, memory=0)
    definition = new_definition(making, "@NAME@", "@", ())
    text = write_definition(definition).decode("ascii").rstrip("\n")
    return text.replace(definition.id, "@ID@").replace('"memory": 0', '"memory": @MEMORY@')


def _host_plan_record(host_plan: HostPlan) -> tuple[str, str]:
    """Return the part of a plan as the journal holds it, before and after its steps, which the script has already."""
    record = _json(host_plan)
    steps = ",".join(map(_json, host_plan.steps))
    before, _, after = record.partition(f'"steps":[{steps}]')
    return f'{before}"steps":[', f"]{after}"


def _json(value: Step | HostPlan) -> str:
    return json.dumps(encode(value), separators=(",", ":"), allow_nan=False)
