"""From a System and what its hosts look like to a Plan: the pure middle of `rarms plan` (the picture in docs/).

Observed states come from live hosts or from snapshots; nothing here knows which.
"""

from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, fields, replace

from rarms_iac.applying.desired_hosts import (
    context_of,
    desired_hosts,
    partitions_present,
    rules_of,
    threads_of,
    totals_after,
)
from rarms_iac.applying.doctor import DOCTOR_ONLY_CODES
from rarms_iac.applying.plan_request import PlanRequest, findings_of_manifest, is_below, targeted, unknown_targets
from rarms_iac.applying.preconditions import hosts_of_one_machine
from rarms_iac.applying.requested_changes import requested_changes
from rarms_iac.applying.review import review_plan
from rarms_iac.applying.scripts import guest_scripts_by_hand, guest_task, of_the_host_itself, with_scripts
from rarms_iac.diff.compare import compare
from rarms_iac.diff.disruption import hold_back
from rarms_iac.diff.drift import part_digests
from rarms_iac.diff.order import order
from rarms_iac.diff.step_context import Difference, ManifestRules, StepContext
from rarms_iac.diff.steps import plan_changes
from rarms_iac.manifest.acceptance import apply_acceptances
from rarms_iac.manifest.checks import CODES
from rarms_iac.manifest.load import load_texts
from rarms_iac.model.changes import Address, Change
from rarms_iac.model.commands import MEASURE, PLAN_OUT, prose
from rarms_iac.model.diagnostics import Diagnostic, Severity, has_errors, in_order
from rarms_iac.model.layout import Layout
from rarms_iac.model.plan import (
    GuestTask,
    HostPlan,
    Plan,
    PlanInputs,
    PlanOrder,
    Purpose,
    Step,
    UnusedPartition,
    wrong_name,
)
from rarms_iac.model.seen_host import SeenHost
from rarms_iac.model.state import State, StopAction, StoppedBy
from rarms_iac.model.version import __version__
from rarms_iac.planner.desired import Desired
from rarms_iac.planner.planning_findings import PROVISIONAL
from rarms_iac.planner.problem import LayoutRefused
from rarms_iac.planner.reservations import RecordedReservations, provisional_on, record
from rarms_iac.storage.plan_file import identified, versions
from rarms_iac.storage.shipped import known_codes
from rarms_iac.texts.indexes import describe_uncertain
from rarms_iac.texts.messages import in_a_row, quoted

_WHOLE_PLAN_CODES = frozenset(known_codes()) - DOCTOR_ONLY_CODES
"""Codes of the findings that a plan of the whole manifest can have."""


@dataclass(frozen=True, slots=True, kw_only=True)
class PlanningResult:
    """A plan, or None where errors forbid one; the findings either way, in order, and those that were accepted."""

    plan: Plan | None
    findings: tuple[Diagnostic, ...]
    accepted: tuple[Diagnostic, ...] = ()


def make_plan(request: PlanRequest, observed: Mapping[str, State]) -> PlanningResult:
    """Make the plan of a request for the observed hosts.

    By the request's purpose it makes them what the manifest wants; or destroys, imports, releases, stops or starts what
    they have.

    Args:
        observed: the State of each host that was looked at, by name.

    Returns:
        The plan, or None and the errors that forbid one. The same input gives the same plan, to the byte.
    """
    asked: dict[str, frozenset[str] | None] = {}
    request = replace(request, after_last_run=_remembering(request.after_last_run, asked))
    hosts, found = desired_hosts(request, observed)
    findings = [*request.findings, *request.snapshot_findings, *found]
    findings += hosts_of_one_machine(request.system, observed, request.places)
    present = partitions_present(request, observed)
    chosen = [desired for name, desired in hosts.items() if name in (request.hosts or observed)]
    planned = [_plan_host(request, desired, present) for desired in chosen]
    findings += [finding for _, _, of_host in planned for finding in of_host]
    if not request.accept_provisional:
        findings += _provisional(request, [part for part, _, _ in planned])
    addresses = [address for _, of_host, _ in planned for address in of_host]
    findings += unknown_targets([*addresses, *sorted(request.gone)], request.targets)
    codes = _WHOLE_PLAN_CODES if request.is_whole else CODES  # an acceptance of these without a finding is one itself
    distinct = in_order(tuple(dict.fromkeys(findings)))
    policy, today = request.system.policy, request.today
    remaining, accepted = apply_acceptances(distinct, policy, request.places, today, codes=codes)
    if has_errors(remaining):
        return PlanningResult(plan=None, findings=remaining, accepted=accepted)
    layout = next((desired.layout for desired in hosts.values()), None)
    unidentified = Plan(
        id="",
        rarms_version=__version__,
        application=request.application,
        robot=request.system.application.robot,
        needs_key=request.system.policy.signed_plans,
        purpose=request.purpose,
        manifest=request.manifest,
        overlays=request.overlays,
        manifest_digest=request.manifest_digest,
        today=request.today.isoformat(),
        max_disruption=request.limit,
        hosts=tuple(host_plan for host_plan, _, _ in planned),
        findings=remaining,
        accepted=accepted,
        placement=None if layout is None else layout.placement,
        inputs=_inputs(request, observed, asked, layout),
    )
    plan, script_findings = with_scripts(identified(unidentified))
    return PlanningResult(
        plan=None if script_findings else plan, findings=in_order((*remaining, *script_findings)), accepted=accepted
    )


def _provisional(request: PlanRequest, parts: Sequence[HostPlan]) -> Iterator[Diagnostic]:
    """Yield one warning of all partitions whose reservation is provisional."""
    names = tuple(name for part in parts for name in part.provisional)
    if not names:
        return
    found = [provisional_on(request.system, request.reservations, part.host, part.provisional) for part in parts]
    uncertain = [each for of_host in found for answer in of_host.values() for each in answer.uncertain]
    needs_consent = any(part.needs_consent for part in parts)
    consent = prose(" To apply this plan anyway: ", PLAN_OUT.also(accept_provisional=True), ".")
    yield PROVISIONAL.at(
        None,
        "{_names} provisional: estimated in the first pass, without bounds.{_uncertain}",
        prose("Measure the rest: ", MEASURE, ".", *((consent,) if needs_consent else ())),
        address=f"partition/{names[0]}",
        partitions=names,
        uncertain=tuple(f"{each.component} {each.index}" for each in uncertain),
        _uncertain=f" {describe_uncertain(uncertain)}" if uncertain else "",
        _names=(
            f"The reservation of {names[0]} is" if len(names) == 1 else f"The reservations of {in_a_row(names)} are"
        ),
    )


def _remembering(
    after_last_run: Callable[[str], frozenset[str] | None], asked: dict[str, frozenset[str] | None]
) -> Callable[[str], frozenset[str] | None]:
    """Return the function with its answers noted by host: they are inputs of the plan, and each reads a journal."""

    def remembered(host: str) -> frozenset[str] | None:
        if host not in asked:
            asked[host] = after_last_run(host)
        return asked[host]

    return remembered


class NotMadeAgain(ValueError):
    """The inputs of a plan make none; `message` says why, as the rest of a sentence about the file."""

    def __init__(self, message: str) -> None:
        super().__init__(message)
        self.message = message


def make_again(inputs: PlanInputs) -> Plan:
    """Make the plan of these inputs, without solving and without a look at a host.

    Raises:
        NotMadeAgain: they make no plan, or the layout does not fit.
    """
    try:
        result = _make_again(inputs)
    except LayoutRefused as error:
        raise NotMadeAgain("its layout does not fit its hosts") from error
    except (ArithmeticError, AssertionError, LookupError, ValueError, AttributeError, TypeError) as error:
        # NOTE: the plan was made when its file was written; what cannot be made was put there since.
        raise NotMadeAgain("no plan can be made of it") from error
    if result.plan is None:
        wrong = next(finding for finding in result.findings if finding.severity is Severity.ERROR)
        raise NotMadeAgain(f"no plan can be made of it ({wrong.code})")
    if name := next(filter(None, map(wrong_name, result.plan.hosts)), None):
        raise NotMadeAgain(f"{quoted(name)} is not a valid name in a manifest")
    return replace(result.plan, inputs=inputs)


def _make_again(inputs: PlanInputs) -> PlanningResult:
    loaded = load_texts(inputs.texts, today=inputs.today)
    if loaded.system is None:
        return PlanningResult(plan=None, findings=loaded.diagnostics)
    if inputs.layout is None and inputs.purpose is Purpose.APPLY and inputs.observed:
        raise LayoutRefused
    request = PlanRequest(
        **{each.name: getattr(inputs, each.name) for each in fields(PlanOrder)},
        system=loaded.system,
        places=loaded.places,
        after_last_run=inputs.after_last_run.get,
        findings=findings_of_manifest(loaded),
        reservations=RecordedReservations(inputs.reservations),
        layout=inputs.layout,
    )
    return make_plan(request, inputs.observed)


def _inputs(
    request: PlanRequest,
    observed: Mapping[str, State],
    after_last_run: Mapping[str, frozenset[str] | None],
    layout: Layout | None,
) -> PlanInputs:
    return PlanInputs(
        **{each.name: getattr(request, each.name) for each in fields(PlanOrder)},
        versions=versions(),
        observed={name: _without_notes(state, request) for name, state in sorted(observed.items())},
        after_last_run=after_last_run,
        reservations=() if layout is None else record(request.system, request.reservations),
        layout=None if layout is None else layout.chosen(),
    )


def _without_notes(state: State, request: PlanRequest) -> State:
    """Leave out what people wrote in the notes of machines that the plan is not about."""
    own = {partition.id.lower() for partition in state.of(request.application).partitions} | {request.machine.lower()}
    return replace(
        state,
        partitions=tuple(
            partition if partition.id.lower() in own else replace(partition, other_notes="")
            for partition in state.partitions
        ),
    )


def _plan_host(
    request: PlanRequest, desired: Desired, present: Mapping[str, frozenset[str]]
) -> tuple[HostPlan, tuple[str, ...], tuple[Diagnostic, ...]]:
    """Return the plan of one host, the addresses of all that is there or wanted, and the findings about both."""
    rules, context = rules_of(request, desired), context_of(request, desired, present)
    difference = _difference(request, desired, context, rules)
    allowed, held_back = hold_back(targeted(difference.changes, request.targets), context)
    ordered = order(plan_changes(allowed, context), context)
    steps, stuck = ((), (ordered,)) if isinstance(ordered, Diagnostic) else (ordered, ())
    guests = _guest_tasks(request, desired, rules)
    host_plan = _host_plan(request, desired, difference, allowed, steps)
    host_plan = replace(host_plan, held_back=held_back, guest_tasks=guests or None)
    reviewed = (*review_plan(request, desired, host_plan), *guest_scripts_by_hand(host_plan, rules.locate))
    addresses = _addresses(desired, (*difference.changes, *guests))
    return host_plan, addresses, (*difference.findings, *stuck, *reviewed)


def _addresses(desired: Desired, changes: Sequence[Change | GuestTask]) -> tuple[str, ...]:
    partitions = (Address(partition=name) for name in sorted(_manifest_partitions(desired)))
    tasks = (Address(partition=task.inside, task=task.name) for task in desired.state.tasks)
    return tuple(dict.fromkeys(map(str, (*(change.address for change in changes), *partitions, *tasks))))


def _host_plan(
    request: PlanRequest, desired: Desired, difference: Difference, allowed: tuple[Change, ...], steps: tuple[Step, ...]
) -> HostPlan:
    seen, observed, application = desired.seen, desired.seen.state, request.application
    mechanisms = {partition.name: partition.mechanism for partition in desired.partitions if partition.mechanism}
    return HostPlan(
        host=seen.host,
        facts=seen.facts,
        state_path=request.state_paths.get(desired.host, ""),
        serial=observed.serials.get(application, 0),
        digests=part_digests(of_the_host_itself(observed), application),
        changes=allowed,
        steps=steps,
        held_back=(),
        unused=tuple(_unused(seen, name) for name in difference.unused),
        unchanged=difference.unchanged,
        scripts={},
        totals=totals_after(observed, application, allowed, _manifest_partitions(desired)),
        threads=threads_of(desired, request.system),
        components={partition.name: partition.components for partition in desired.partitions},
        mechanisms=mechanisms or None,
        provisional=tuple(
            provisional_on(
                request.system, request.reservations, seen.host, {partition.name for partition in desired.partitions}
            )
        ),
        stopped=_staying_stopped(request, desired),
    )


def _guest_tasks(request: PlanRequest, desired: Desired, rules: ManifestRules) -> tuple[GuestTask, ...]:
    """Return the classes that the guests' scripts write, as far as they are targets, by partition and name."""
    machines = {name: vm.id for name, vm in desired.seen.present.items()}
    tasks = (
        guest_task(task, rules.replaceable, rules.locate, machines.get(task.inside, "")) for task in desired.by_hand
    )
    return tuple(
        task
        for task in sorted(tasks, key=lambda task: (task.partition, task.name))
        if is_below(str(task.address), request.targets)
    )


def _manifest_partitions(desired: Desired) -> frozenset[str]:
    """Return the partitions of a host that the manifest names: those that it is to have, and those that are there."""
    wanted = {partition.settings.name for partition in desired.state.partitions}
    return frozenset(desired.seen.present.keys() | wanted) - desired.unnamed


def _unused(seen: SeenHost, name: str) -> UnusedPartition:
    """Return the resources of a partition that the manifest no longer names."""
    machine = seen.present[name]
    saves = machine.settings.stop_action is StopAction.SAVE
    return UnusedPartition(
        name=name,
        memory_on_disk=machine.settings.memory if saves else 0,
        disks=tuple(disk.path for disk in seen.state.disks if disk.machine == machine.id),
    )


def _staying_stopped(request: PlanRequest, desired: Desired) -> tuple[str, ...]:
    """Return the partitions of the manifest that `rarms stop` stopped, where the plan asks for all of the manifest."""
    if request.purpose is not Purpose.APPLY:
        return ()
    wanted = (partition.mark for partition in desired.state.partitions if partition.mark)
    return tuple(sorted(mark.name for mark in wanted if mark.stopped_by is StoppedBy.USER))


def _difference(request: PlanRequest, desired: Desired, context: StepContext, rules: ManifestRules) -> Difference:
    """Return the changes of the host for this purpose."""
    if request.purpose in {Purpose.APPLY, Purpose.DESTROY}:
        return compare(desired.state, desired.seen.state, request.application, context, rules)
    found = tuple(requested_changes(desired.seen.state, request, rules.locate))
    findings = tuple(finding for finding in found if isinstance(finding, Diagnostic))
    changes = tuple(change for change in found if not isinstance(change, Diagnostic))
    is_so = not found and request.purpose in {Purpose.IMPORT, Purpose.RELEASE}
    return Difference(changes=list(changes), unchanged=int(is_so), findings=list(findings))
