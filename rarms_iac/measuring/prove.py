"""Proving: finds the applied layout on the hosts, runs all its components together and judges them by their APTs."""

from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from math import isfinite
from typing import Literal

from rarms_iac.app.control import UNATTENDED, Control, FinishedUnit, UnitEnding, UnitValue, WorkBegun
from rarms_iac.app.hosts import Hosts
from rarms_iac.app.measurement_files import hold_configuration_logs, log_errors, now
from rarms_iac.app.requests import flag, load_host_option, lock_timeout_option, option, refuse_unknown
from rarms_iac.app.use_case_errors import Outcome, RequestError, UseCaseError
from rarms_iac.measuring import findings
from rarms_iac.measuring.applied_layout import applied_layouts, observe_others, refuse_unapplied
from rarms_iac.measuring.duration import Announced, forecast
from rarms_iac.measuring.findings import OCCUPIED
from rarms_iac.measuring.measure_request import USUAL_SEED
from rarms_iac.measuring.missed_thresholds import proof_findings
from rarms_iac.measuring.on_robot import ExperimentListener, ask_robot
from rarms_iac.measuring.other_work import work_of_evidence
from rarms_iac.measuring.partitions import MeasuringResources, host_resources
from rarms_iac.measuring.proof import (
    STARTS,
    AppliedLayout,
    IndexVerdict,
    LayoutProof,
    LoadPartition,
    ProofConditions,
    least_duration_ms,
    load_partition,
    prove,
    with_samples,
)
from rarms_iac.measuring.session import (
    MeasuringSession,
    hold_measuring_hosts,
    no_measurable_host,
    refuse_what_cannot_run,
    start_warnings_of,
)
from rarms_iac.measuring.units import describe_missing_part
from rarms_iac.model.commands import CommandOption, RecommendedCommand, command, prose
from rarms_iac.model.diagnostics import Diagnostic
from rarms_iac.model.host import ProviderKind
from rarms_iac.model.loads import Interference
from rarms_iac.model.outcomes import TooManyFailures, verdict_word
from rarms_iac.model.output import Internal, output
from rarms_iac.model.state import State
from rarms_iac.model.system import System
from rarms_iac.model.version import __version__
from rarms_iac.planner.groups import groups_of
from rarms_iac.storage.datalog.decisions import Entry, Proven, ProvenIndex, read_entries
from rarms_iac.storage.datalog.files import append_to_log, configuration_path
from rarms_iac.texts.messages import counted, in_a_row

LEAST_PROOF = 1_200_000.0
"""The time of the host, in ms, that a proof has at least where the manifest does not say it."""


@dataclass(frozen=True, slots=True, kw_only=True)
class ProveRequest:
    """The request of `rarms prove`."""

    interference: tuple[str, ...] = option(
        "--interference",
        metavar="NAME",
        help="Prove with this load; repeatable, one after the other. [default: the policy's]",
        default=(),
    )
    without_load: bool = flag("--without-load", help="Prove without a load; the logs record it.")
    load_host: bool = load_host_option()
    samples: int | None = option(
        "--samples",
        least=2,
        help="Take at least this many samples of each component. [default: as many as its thresholds need]",
    )
    seed: int = option("--seed", least=1, help="Seed of the random numbers. [default: 1]", default=USUAL_SEED)
    lock_timeout_ms: int = lock_timeout_option()


@dataclass(frozen=True, slots=True, kw_only=True)
class ProveOutcome:
    """The results of the components, all together."""

    kind: Literal["prove"] = "prove"
    proofs: tuple[LayoutProof, ...]  # one a host and load
    findings: tuple[Diagnostic, ...]  # thresholds that are not shown to be met
    not_proven: tuple[str, ...] = ()  # partitions on hosts that cannot run components
    stopped: Internal[bool] = False  # an end was asked for: `proofs` has those that had ended
    remaining: tuple[str, ...] = ()  # loads that a stopped proof has not proven with

    @output
    def met(self) -> bool:
        """Whether each index was shown to meet its threshold with each load, by a proof that ended."""
        return bool(self.proofs) and not self.stopped and not any(proof.not_met for proof in self.proofs)


def prove_layout(
    hosts: Hosts,
    request: ProveRequest = ProveRequest(),
    control: Control = UNATTENDED,
) -> ProveOutcome:
    """Run all components together where they are applied, and judge every index against its threshold.

    They run with the loads of the policy, one after the other. What they show with a load is written into the
    configuration logs once that has ended, with any result, and stays where the next one is stopped.

    Args:
        hosts: Those that can run components are held meanwhile.
        control: The caller's part; its reporter hears what an earlier run that was killed had left on the hosts, and
            before it begins that all idle time of the hosts is used, and how long.

    Returns:
        The proofs by host name and load, the thresholds that are not shown to be met, and what could not be run.

    Raises:
        RequestError: The manifest has no such interference.
        UseCaseError: The manifest asks for what is not on the hosts, or a host is held (refused); it cannot be
            planned, a log is damaged, or too many samples failed (negative); no host can run components (failed).
    """
    if request.interference and request.without_load:
        raise RequestError("--without-load cannot be combined with --interference.")
    refuse_unknown(request.interference, hosts.system.interference, "interference")
    names = _measurable_hosts(hosts)
    if any(hosts.robot(name) for name in names):
        return _prove_on_each(hosts, names, request, control)
    session = MeasuringSession(
        hosts=hosts, control=control, command="prove", seed=request.seed, lock_timeout_ms=request.lock_timeout_ms
    )
    with hold_measuring_hosts(session, names) as holding, control.stop.gently():
        states = {name: host.observe() for name, host in holding.held_hosts.items()}
        everywhere = {**observe_others(hosts, names), **states}
        layouts = _layouts_to_prove(hosts, states, everywhere, request.samples)
        loads = loads_to_prove(hosts.system, request)
        proofs, remaining = _prove_all(holding, layouts, states, loads)
    if remaining is not None:
        return ProveOutcome(proofs=tuple(proofs), findings=(), stopped=True, remaining=remaining)
    system_hosts = hosts.system.hosts
    started = [(system_hosts[name], each.name) for name, layout in layouts.items() for each in layout.components]
    proven = {name for layout in layouts.values() for name in layout.partitions}
    return ProveOutcome(
        proofs=tuple(proofs),
        findings=(
            *start_warnings_of(hosts.manifest, started),
            *proof_findings(hosts, proofs, everywhere, load_host=request.load_host),
            *_work_findings(hosts, proofs),
        ),
        not_proven=tuple(group.name for group in groups_of(hosts.system) if group.name not in proven),
    )


def _prove_on_each(hosts: Hosts, names: Sequence[str], request: ProveRequest, control: Control) -> ProveOutcome:
    """Prove host after host, those that are robots by their own rarms."""
    here = [name for name in names if hosts.robot(name) is None]
    outcomes = [prove_layout(hosts.only(*here), request, control)] if here else []
    for name in names:
        if name not in here and not (outcomes and outcomes[-1].stopped):
            outcomes.append(_prove_there(hosts.only(name), request, control))
    proofs = sorted((proof for outcome in outcomes for proof in outcome.proofs), key=lambda proof: proof.host)
    return ProveOutcome(
        proofs=tuple(proofs),
        findings=tuple(finding for outcome in outcomes for finding in outcome.findings),
        not_proven=tuple(
            name for name in outcomes[0].not_proven if all(name in outcome.not_proven for outcome in outcomes)
        ),
        stopped=any(outcome.stopped for outcome in outcomes),
        remaining=tuple(load for outcome in outcomes for load in outcome.remaining),
    )


def _prove_there(hosts: Hosts, request: ProveRequest, control: Control) -> ProveOutcome:
    """Have the one chosen host, a robot, prove its layout."""
    (name,) = hosts.chosen
    follower = ExperimentListener(hosts=hosts, host=name, control=control)
    components = (each.name for each in hosts.system.components.values() if each.may_run_on(name))
    loads = loads_to_prove(hosts.system, request)
    return ask_robot(follower, "prove", request, ProveOutcome, components=components, loads=loads)


def _layouts_to_prove(
    hosts: Hosts, states: Mapping[str, State], everywhere: Mapping[str, State], samples: int | None
) -> Mapping[str, AppliedLayout]:
    """Return the applied layouts by host; what would make their proofs useless is found before components run."""
    applied = applied_layouts(hosts, states, everywhere)
    layouts = {name: with_samples(layout, samples) for name, layout in applied.items()}
    refuse_unapplied(hosts, states, everywhere)
    for name, layout in layouts.items():
        _recorded(hosts, name, layout)  # refuses a log that nothing can be added to
    return layouts


def _prove_all(
    session: MeasuringSession,
    layouts: Mapping[str, AppliedLayout],
    states: Mapping[str, State],
    loads: Sequence[str],
) -> tuple[list[LayoutProof], tuple[str, ...] | None]:
    """Prove layout after layout, each with load after load, and record each proof.

    Returns:
        The proofs that ended, and the loads that are left where an end was asked for; None: it was not.
    """
    proofs: list[LayoutProof] = []
    reporter, clock, of = session.control.reporter, session.wall_times.clock, max(1, len(loads)) * len(layouts)
    reporter.settings.work_begun(WorkBegun(units=of))
    thresholds = sum(len(component.apt) for layout in layouts.values() for component in layout.judged)
    for name, layout in layouts.items():
        conditions = _conditions(session, states[name], layout, loads, thresholds)
        announced, by_host = _announce(session, name, layout, conditions)
        left_ms = proof_budget_ms(session.hosts.system, len(conditions))
        for number, each in enumerate(conditions):
            began = clock()
            within = replace(each, budget_ms=left_ms / (len(conditions) - number))
            proof = _prove(session, name, layout, within, announced.look if by_host else _looking(announced, clock))
            if proof is None:
                left = [each.interference for each in conditions[number:] if each.interference]
                return proofs, tuple(left) if len(layouts) == 1 else ()  # of several hosts all are proven again
            left_ms = max(0.0, left_ms - proof.host_ms)
            proofs.append(replace(proof, wall_seconds=clock() - began))
            with hold_configuration_logs(session.hosts.folder), log_errors():
                _record(session.hosts, proofs[-1:], states)
            reporter.settings.unit_ended(_unit_of(proof, len(proofs), of))
            announced.add(proof.host_ms if by_host else 1000 * proofs[-1].wall_seconds)
    return proofs, None


def proof_budget_ms(system: System, runs: int) -> float:
    """Return how long a proof may take: as the manifest says, else as long with each load as a setting may.

    Args:
        runs: how many loads there are, at least 1.
    """
    limits = system.policy.measuring
    if limits.proof is not None:
        return float(limits.proof)
    return max(LEAST_PROOF, runs * float(limits.setting))


def continue_command(outcome: ProveOutcome, request: ProveRequest, hosts: Sequence[str]) -> RecommendedCommand:
    """Return the command that proves with the loads that a stopped proof left; with all where that is not known.

    Args:
        hosts: the chosen ones, by name; none: all of the manifest.
    """
    loads = (outcome.remaining if outcome.proofs else ()) or request.interference
    named = (
        *(CommandOption("--host", name) for name in hosts),
        *(CommandOption("--interference", load) for load in dict.fromkeys(loads)),
    )
    again = replace(command("prove"), options=named)
    return again.also(
        without_load=request.without_load,
        load_host=request.load_host,
        samples=request.samples or False,
        seed=request.seed != USUAL_SEED and request.seed,
    )


def _unit_of(proof: LayoutProof, number: int, of: int) -> FinishedUnit:
    """Return the report of a layout's proof with one load: of a miss the values that miss, else all."""
    words = [verdict_word(each.verdict) for each in proof.verdicts]
    ending: UnitEnding = "missed" if "missed" in words else "met" if set(words) <= {"met"} else "inconclusive"
    shown = [each.measured for each, word in zip(proof.verdicts, words, strict=True) if word == ending]
    values = (
        UnitValue(index=each.index, value=each.estimate.value, threshold=each.threshold, component=each.component)
        for each in shown
        if each.estimate is not None
    )
    load = proof.interference or "no load"
    return FinishedUnit(number=number, of=of, subject=proof.host, load=load, values=tuple(values), ending=ending)


def _looking(announced: Announced, clock: Callable[[], float]) -> Callable[[float], None]:
    """Return a look at an announced time by the user's clock, from now on; it ignores the time of the host."""
    began = clock()
    return lambda _host_ms: announced.look(1000 * (clock() - began))


def loads_to_prove(system: System, request: ProveRequest) -> tuple[str, ...]:
    """Name the loads with which a layout is proven, one after the other.

    Args:
        request: may name others, or none.

    Returns:
        Names of `interference`; empty: it is proven without a load.
    """
    if request.without_load:
        return ()
    return request.interference or system.policy.interference


def _announce(
    session: MeasuringSession, name: str, layout: AppliedLayout, conditions: Sequence[ProofConditions]
) -> tuple[Announced, bool]:
    """Say what a proof takes of a host, before it begins.

    Returns:
        The longest time, and whether it is by the host's clock instead of the user's.
    """
    loads = [each.interference for each in conditions if each.interference]
    with_load = f"with {in_a_row(loads)}, using all idle time" if loads else "without load"
    least = most = _last_proof_ms(session.hosts, name, layout, [each.interference for each in conditions])
    simulated, clock = "", ""
    is_simulated = session.hosts.system.hosts[name].provider is ProviderKind.SIMULATED
    if is_simulated:  # its clock is not the user's
        simulated, clock = " (simulated)", "" if most else " of host time"
    if not (is_simulated and most):
        window_ms = session.held_hosts[name].scheduler_memory_ms
        least = sum(least_duration_ms(layout, window_ms, each.budget_ms) for each in conditions)
        most = max(least, proof_budget_ms(session.hosts.system, len(conditions)))
    starts = f"at least {counted(STARTS * len(conditions), 'start')} of all components"
    message = f"Proof on {name}{simulated} {with_load}: {starts}, {forecast(least, most)}{clock}."
    session.control.reporter.message(message)
    parts = {each.interference: each.load_partition for each in conditions}
    if short := [load for load, partition in parts.items() if load and partition and partition.lacks_part]:
        session.control.reporter.message(describe_missing_part(name, short))
    return Announced(work=f"The proof on {name}", most_ms=most, say=session.control.reporter.message), bool(clock)


def _last_proof_ms(hosts: Hosts, host: str, layout: AppliedLayout, loads: Sequence[str | None]) -> float:
    """Return the duration of the last proofs with all loads together; 0: one load has no proof yet."""
    proofs = (entry for entry in _recorded(hosts, host, layout) if isinstance(entry, Proven))
    took = {proof.interference: proof.wall_seconds for proof in proofs if proof.host == host}
    return 1000 * sum(took[load] for load in loads) if all(took.get(load) for load in loads) else 0.0


def _recorded(hosts: Hosts, host: str, layout: AppliedLayout) -> tuple[Entry, ...]:
    """Return the entries of the configuration logs of a layout's components."""
    platform = hosts.system.hosts[host].platform
    logs = [configuration_path(hosts.folder, platform, component.name) for component in layout.judged]
    with log_errors():
        return tuple(entry for log in logs for entry in read_entries(log))


def _record(hosts: Hosts, proofs: Sequence[LayoutProof], states: Mapping[str, State]) -> None:
    """Write every PI against its APT into the configuration logs, with any result."""
    for proof in proofs:
        application = proof.layout.application
        reserves = {
            partition.mark.name: partition.settings.reserve
            for partition in states[proof.host].of(application).partitions
            if partition.mark
        }
        partition_of = {member.name: name for name, members in proof.layout.partitions.items() for member in members}
        everyone = tuple(component.name for component in proof.layout.components)
        for component in proof.layout.judged:
            entry = Proven(
                component=component.name,
                when=now("microseconds"),
                rarms_version=__version__,
                host=proof.host,
                interference=proof.interference,
                robot=hosts.system.application.robot,
                machine=states[proof.host].facts.id,
                serial=states[proof.host].serials.get(application, 0),
                wall_seconds=round(proof.wall_seconds, 1),
                partition=partition_of.get(component.name, ""),
                reserve=reserves.get(partition_of.get(component.name, ""), 0),
                layout=reserves,
                beside=tuple(name for name in everyone if name != component.name),
                indexes=tuple(
                    _proven(verdict) for verdict in proof.verdicts if verdict.measured.component == component.name
                ),
            )
            platform = hosts.system.hosts[proof.host].platform
            append_to_log(configuration_path(hosts.folder, platform, component.name), entry)


def _proven(verdict: IndexVerdict) -> ProvenIndex:
    estimate = verdict.measured.estimate
    return ProvenIndex(
        index=verdict.measured.index,
        threshold=verdict.measured.threshold,
        value=estimate.value if estimate else None,
        lower=estimate.lower if estimate and isfinite(estimate.lower) else None,
        upper=estimate.upper if estimate and isfinite(estimate.upper) else None,
        met=verdict.met,
        verdict=verdict_word(verdict.verdict),
        error=verdict.error,
        samples_needed=verdict.samples_needed,
    )


def _measurable_hosts(hosts: Hosts) -> tuple[str, ...]:
    measurable = tuple(name for name in hosts.chosen if hosts.can_run_on(name))
    if not measurable:
        raise no_measurable_host(
            hosts, "Run the components there by hand, and compare their values with the thresholds."
        )
    return measurable


def _conditions(
    session: MeasuringSession, state: State, layout: AppliedLayout, loads: Sequence[str], thresholds: int
) -> tuple[ProofConditions, ...]:
    """Return the conditions under which the layout of a host is run, in their order.

    Raises:
        UseCaseError: no room for a load, or the host cannot run it or a component (negative).
    """
    system, host = session.hosts.system, session.held_hosts[state.facts.name]
    refuse_what_cannot_run(
        session,
        host,
        components={component.name: component for component in layout.components},
        loads={load: system.interference[load] for load in loads},
        in_their_partitions=True,
    )
    room = host_resources(system.hosts[host.name], state, system.application.name)
    runs = max(1, len(loads))
    # All loads of the policy share the error, also where a stopped proof continues with the rest of them.
    statements = max(runs, len(loads_to_prove(system, ProveRequest())))
    conditions = ProofConditions(
        load_partition=None,
        interference=None,
        seed=session.seed or USUAL_SEED,
        budget_ms=proof_budget_ms(system, runs) / runs,
        statements=statements * thresholds,
        slow_job=system.policy.measuring.slow_job,
    )
    if not loads:
        return (conditions,)
    return tuple(
        replace(
            conditions,
            interference=load,
            load_partition=_make_load(system.interference[load], room, load, host.name),
        )
        for load in loads
    )


def _make_load(load: Interference, room: MeasuringResources, name: str, host: str) -> LoadPartition:
    partition = load_partition(load, room)
    if partition is None:
        advice = prose("Free some memory, or prove without a load: ", command("prove", without_load=True), ".")
        finding = OCCUPIED.at(
            None,
            "{host} does not have enough memory for the partition of {interference}.",
            advice,
            host=host,
            interference=name,
        )
        raise UseCaseError(Outcome.NEGATIVE, [finding])
    return partition


def _work_findings(hosts: Hosts, proofs: Sequence[LayoutProof]) -> Iterator[Diagnostic]:
    """Find work outside of the partitions and kills for memory, of all proofs of a host together."""
    places = hosts.manifest.places
    by_host: dict[str, list[LayoutProof]] = {}
    for proof in proofs:
        by_host.setdefault(proof.host, []).append(proof)
    for of_host in by_host.values():
        names = [component.name for component in of_host[0].layout.components]
        evidence = [each for proof in of_host for each in proof.evidence]
        yield from work_of_evidence(names, evidence, places, evidence)


def _prove(
    session: MeasuringSession,
    name: str,
    layout: AppliedLayout,
    conditions: ProofConditions,
    look: Callable[[float], None],
) -> LayoutProof | None:
    """Prove one host's layout with one load; None where an end was asked for."""
    manifest = session.hosts.manifest
    answer = prove(session.held_hosts[name], layout, conditions, session.control, look)
    if isinstance(answer, TooManyFailures):
        finding = findings.failed_samples(answer, "in the layout", manifest.places)
        raise UseCaseError(Outcome.NEGATIVE, [finding], manifest.sources)
    return answer
