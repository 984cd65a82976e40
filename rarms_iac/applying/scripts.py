"""The scripts of a plan: for Hyper-V hosts the exact texts that run, which every PowerShell can read."""

from collections.abc import Callable, Iterator, Mapping
from dataclasses import replace

from rarms_iac.model.changes import Address
from rarms_iac.model.commands import command, prose
from rarms_iac.model.diagnostics import SCRIPT_REFUSED, Diagnostic, Finding, Place
from rarms_iac.model.host import ProviderKind
from rarms_iac.model.plan import GuestTask, HostPlan, Plan
from rarms_iac.model.state import State, TaskClass
from rarms_iac.powershell.literals import NoLiteral, unreadable
from rarms_iac.powershell.render import insides, render_scripts, script_name

BY_HAND = Finding.note("RARMS160", "A guest's script is run by hand")

Locate = Callable[[Address], Place | None]


def guest_task(task_class: TaskClass, replaceable: frozenset[str], locate: Locate, machine: str) -> GuestTask:
    """Return a class that is wanted in a guest that could not be looked into, as the guest's script writes it.

    Args:
        replaceable: names in lower case of shipped classes that may be taken over.
        machine: the id of the partition's machine; empty where there is none yet.
    """
    assert task_class.record is not None, "what is wanted is recorded"
    return GuestTask(
        partition=task_class.inside,
        name=task_class.name,
        values=task_class.values,
        set=task_class.record.set,
        replace=task_class.name.lower() in replaceable,
        place=locate(Address(partition=task_class.inside, task=task_class.name)),
        machine=machine,
    )


def guest_scripts_by_hand(host_plan: HostPlan, locate: Locate) -> Iterator[Diagnostic]:
    """Yield that the scripts of guests do not run with the host's: nothing reaches into a guest."""
    if host_plan.facts.provider is not ProviderKind.HYPERV:
        return
    unseen = {task.partition for task in host_plan.guest_tasks or ()}
    for inside in filter(None, insides(host_plan)):
        name = script_name(host_plan, inside)
        how = "could not be looked into: its own record decides what is done" if inside in unseen else "was looked into"
        yield BY_HAND.at(
            locate(Address(partition=inside)),
            "The task classes of {partition} lie in its guest, which {_how}. The plan holds the script that "
            "writes them, {script}; applying the plan does not run it.",
            prose(
                "Write it out (",
                command("show", "PLAN", script=True, guest=inside, out="FOLDER"),
                "), take it and its undo script into the guest, and run it there as administrator. The next "
                f"plan compares what observe.ps1 printed inside: `--snapshot {host_plan.host.name}.guest.{inside}"
                "=FILE`.",
            ),
            address=f"partition/{inside}",
            partition=inside,
            script=name,
            _how=how,
        )


def of_the_host_itself(state: State) -> State:
    """Remove readings from inside a Hyper-V host's guests: its script neither sees nor changes them."""
    if state.facts.provider is not ProviderKind.HYPERV:
        return state
    return replace(state, tasks=tuple(task for task in state.tasks if not task.inside))


def with_scripts(plan: Plan) -> tuple[Plan, tuple[Diagnostic, ...]]:
    """Return the plan with the scripts of its Hyper-V hosts, and what forbids to show or run one of them."""
    hosts: list[HostPlan] = []
    findings: list[Diagnostic] = []
    for part in plan.hosts:
        scripts: Mapping[str, bytes] = {}
        if part.facts.provider is ProviderKind.HYPERV:
            try:
                scripts = render_scripts(part, plan)
            except NoLiteral as error:
                findings.append(_no_literal(part, error))
        findings += [problem for name, script in scripts.items() for problem in unreadable(script, name)]
        hosts.append(replace(part, scripts={name: text.decode("ascii") for name, text in scripts.items()}))
    return replace(plan, hosts=tuple(hosts)), tuple(findings)


def _no_literal(part: HostPlan, error: NoLiteral) -> Diagnostic:
    return SCRIPT_REFUSED.of_host(
        part.host.name,
        "{host}: {reason}.",
        "Take the character out of the name or path where the manifest or the host says it.",
        reason=str(error),
    )
