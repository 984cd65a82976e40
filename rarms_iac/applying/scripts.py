"""The scripts of a plan: for Hyper-V hosts the exact texts that run, which every PowerShell can read."""

from collections.abc import Callable, Iterator, Mapping
from dataclasses import replace

from rarms_iac.model.changes import Address
from rarms_iac.model.commands import command, prose
from rarms_iac.model.diagnostics import Diagnostic, Place
from rarms_iac.model.host import ProviderKind
from rarms_iac.model.plan import GuestTask, HostPlan, HostSteps, Plan, RunIdentity
from rarms_iac.model.state import State, TaskClass
from rarms_iac.powershell.literals import NoLiteral, unreadable
from rarms_iac.powershell.render import insides, render_scripts, script_name
from rarms_iac.texts.findings import SCRIPT_REFUSED, Finding

BY_HAND = Finding.note("RARMS160", "A guest's script is run by hand")

Locate = Callable[[Address], Place | None]


def guest_task(task_class: TaskClass, replaceable: frozenset[str], locate: Locate, machine: str) -> GuestTask:
    """Return a class that is wanted in a guest that could not be looked into, as the guest's script writes it.

    Args:
        replaceable: names in lower case of shipped classes that may be taken over.
        machine: the id of the partition's machine; empty where there is none yet.
    """
    assert task_class.record is not None, "a wanted class has a record"
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
        how = (
            "rarms could not read the guest, so the script decides by its own record."
            if inside in unseen
            else "rarms read the guest."
        )
        yield BY_HAND.at(
            locate(Address(partition=inside)),
            (
                "The task classes of {partition} are in its guest. {_how} The plan contains the script {script} "
                "for the guest, but `rarms apply` does not run it."
            ),
            prose(
                "Write the script: ",
                command("show", "PLAN", script=True, guest=inside, out="FOLDER"),
                (
                    ". Copy the script and its undo script into the guest, and run the script there as "
                    "administrator. To compare the guest in the next plan, run observe.ps1 in the guest and give "
                    f"its output: `--snapshot {host_plan.host.name}.guest.{inside}=FILE`."
                ),
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
        scripts, problems = scripts_of(part, plan) if part.facts.provider is ProviderKind.HYPERV else ({}, ())
        hosts.append(replace(part, scripts=scripts))
        findings += problems
    return replace(plan, hosts=tuple(hosts)), tuple(findings)


def scripts_of(on: HostSteps, run: RunIdentity) -> tuple[Mapping[str, str], tuple[Diagnostic, ...]]:
    """Return the scripts of a host by file name, and what forbids to show or run one of them."""
    try:
        scripts = render_scripts(on, run)
    except NoLiteral as error:
        return {}, (_no_literal(on.host.name, error),)
    problems = tuple(problem for name, script in scripts.items() for problem in unreadable(script, name))
    return {name: text.decode("ascii") for name, text in scripts.items()}, problems


def _no_literal(host: str, error: NoLiteral) -> Diagnostic:
    return SCRIPT_REFUSED.of_host(
        host,
        "{host}: {reason}.",
        "Remove the character from the name or path in the manifest or on the host.",
        reason=str(error),
    )
