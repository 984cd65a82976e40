"""Proving: finds the applied layout on the hosts, runs all its components together and judges them by their APTs."""

from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import suppress
from dataclasses import dataclass
from functools import partial
from math import isfinite
from pathlib import Path
from typing import Literal, assert_never

from rarms_iac.app.control import UNATTENDED, Control
from rarms_iac.app.errors import Outcome, UseCaseError
from rarms_iac.app.experiments.measure_request import USUAL_SEED, refuse_unknown
from rarms_iac.app.experiments.session import MeasuringSession, hold_hosts
from rarms_iac.app.hosts import Hosts, observe_host
from rarms_iac.app.measurement_files import hold_configuration_logs, now
from rarms_iac.app.options import lock_timeout_option, option
from rarms_iac.app.planning import make_plan, plan_request
from rarms_iac.app.requests import PlanLimits
from rarms_iac.applying.state_after import totals_after
from rarms_iac.measuring import measuring_findings
from rarms_iac.measuring.measuring_findings import index_facts, show_index
from rarms_iac.measuring.partitions import host_budget, partition_name
from rarms_iac.measuring.prove import (
    AppliedLayout,
    IndexVerdict,
    LayoutProof,
    ProofConditions,
    load_partition,
    prove,
    with_samples,
)
from rarms_iac.model.commands import APPLY, PLAN, Wording, command, prose
from rarms_iac.model.diagnostics import Diagnostic, Facts, Finding
from rarms_iac.model.indexes import index_named, show_threshold
from rarms_iac.model.outcomes import Met, Missed, TooFewSamples, TooManyFailures, Unsteady, WithinNoise, verdict_word
from rarms_iac.model.output import Internal, output
from rarms_iac.model.quantities import guaranteed
from rarms_iac.model.series import Series
from rarms_iac.model.state import State, StoppedBy
from rarms_iac.model.system import Component, Disruption, RunsOn
from rarms_iac.model.version import __version__
from rarms_iac.planner.groups import Group, groups_of
from rarms_iac.planner.mechanism import deadline_period_us
from rarms_iac.storage.datalog.decisions import Proven, ProvenIndex, append_entry
from rarms_iac.storage.datalog.files import configuration_path


@dataclass(frozen=True, slots=True, kw_only=True)
class ProveRequest:
    """How an applied layout is to be run."""

    interference: str | None = option(
        "--interference", metavar="NAME", help="Run this load beside them. [default: none]"
    )
    samples: int | None = option("--samples", least=2, help="So many a component. [default: as `run.until` says]")
    seed: int = option("--seed", least=1, help="Draw chance from here. [default: 1]", default=USUAL_SEED)
    lock_timeout_ms: int = lock_timeout_option()


@dataclass(frozen=True, slots=True, kw_only=True)
class ProveOutcome:
    """What the components showed, all together."""

    kind: Literal["prove"] = "prove"
    interference: str | None = None  # the load that ran beside them
    proofs: tuple[LayoutProof, ...]  # a host each
    findings: tuple[Diagnostic, ...]  # thresholds that are not shown to be met
    not_proven: tuple[str, ...] = ()  # partitions on hosts that cannot run components
    stopped: Internal[bool] = False  # an end was asked for: nothing is proven

    @property
    @output
    def met(self) -> bool:
        """Whether each index was shown to meet its threshold."""
        return not any(proof.not_met for proof in self.proofs)


SampleListener = Callable[[str, Mapping[str, Series]], None]
"""Called with the name of a host and the samples of its components so far, as they come."""


def prove_layout(
    hosts: Hosts,
    request: ProveRequest = ProveRequest(),
    control: Control = UNATTENDED,
    listener: SampleListener = lambda _host, _series: None,
) -> ProveOutcome:
    """Run all components together where they are applied, and judge every index beside its threshold.

    What they show is written into the configuration logs, with any result.

    Args:
        hosts: Those that can run components are held meanwhile.
        request: Beside which load, and how long.
        control: The caller's part; its reporter hears what an earlier run that was killed had left on the hosts.
        listener: Called as samples come.

    Returns:
        The proofs by host name, the thresholds that are not shown to be met, and what could not be run.

    Raises:
        RequestError: The manifest has no such interference.
        UseCaseError: The manifest asks for what is not on the hosts, or a host is held (refused); it cannot be
            planned, or too many samples failed (negative); no host can run components (failed).
    """
    if request.interference:
        refuse_unknown((request.interference,), hosts.system.interference, "interference")
    names = _measurable_hosts(hosts)
    proofs: list[LayoutProof] = []
    session = MeasuringSession(
        hosts=hosts, control=control, command="prove", seed=request.seed, lock_timeout_ms=request.lock_timeout_ms
    )
    with hold_hosts(session, names) as held, control.stop.gently():
        states = {name: host.observe() for name, host in held.held.items()}
        everywhere = {**_observe_others(hosts, names), **states}
        layouts = applied_layouts(hosts, states, everywhere)
        _refuse_unapplied(hosts, states, everywhere)
        for name, layout in layouts.items():
            conditions = _conditions(hosts, states[name], name, request)
            proof = _prove(held, name, with_samples(layout, request.samples), conditions, listener)
            if proof is None:
                return ProveOutcome(proofs=(), findings=(), stopped=True)
            proofs.append(proof)
    with hold_configuration_logs(Path(hosts.folder)):
        _record(hosts, proofs, states)
    return ProveOutcome(
        interference=request.interference,
        proofs=tuple(proofs),
        findings=tuple(_not_met(hosts, proofs)),
        not_proven=_not_proven(hosts, layouts),
    )


def _record(hosts: Hosts, proofs: list[LayoutProof], states: Mapping[str, State]) -> None:
    """Write every PI beside its APT into the configuration logs, with any result."""
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
                when=now(),
                rarms_version=__version__,
                host=proof.host,
                partition=partition_of.get(component.name, ""),
                reserve=reserves.get(partition_of.get(component.name, ""), 0),
                beside=tuple(name for name in everyone if name != component.name),
                indexes=tuple(
                    _proven(verdict) for verdict in proof.verdicts if verdict.measured.component == component.name
                ),
            )
            platform = hosts.system.hosts[proof.host].platform
            append_entry(configuration_path(Path(hosts.folder), platform, component.name), entry)


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
    )


def _observe_others(hosts: Hosts, measurable: tuple[str, ...]) -> dict[str, State]:
    """Observe the hosts that are not measurable, where they can be reached: their partitions are not missing either."""
    states: dict[str, State] = {}
    for name in sorted(set(hosts.system.hosts) - set(measurable)):
        with suppress(UseCaseError):
            states[name] = observe_host(hosts.open(name))
    return states


def _not_proven(hosts: Hosts, layouts: Mapping[str, AppliedLayout]) -> tuple[str, ...]:
    proven = {name for layout in layouts.values() for name in layout.partitions}
    return tuple(group.name for group in groups_of(hosts.system) if group.name not in proven)


def applied_layouts(
    hosts: Hosts, states: Mapping[str, State], everywhere: Mapping[str, State]
) -> dict[str, AppliedLayout]:
    """Return by host what of the manifest runs there.

    Args:
        hosts: Those of the manifest.
        states: Of hosts that can run components.
        everywhere: The same, and those of other hosts that could be reached.

    Returns:
        Layouts by host name; a host on which nothing of the manifest runs has none.

    Raises:
        UseCaseError: A partition is on no host, or does not run (refused).
    """
    system = hosts.system
    application = system.application.name
    running = {
        partition.mark.name: name
        for name, state in everywhere.items()
        for partition in state.of(application).partitions
        if partition.mark and partition.settings.running
    }
    groups = groups_of(system)
    _refuse_stopped(everywhere, application)
    if absent := [group.name for group in groups if group.name not in running]:
        message = f"These partitions are on no host, or do not run: {', '.join(absent)}."
        raise UseCaseError(
            Outcome.REFUSED, [_not_applied(message, f"partition/{absent[0]}", {"partitions": tuple(absent)})]
        )
    layouts = {
        name: _layout_on(hosts, name, states, [group for group in groups if running[group.name] == name])
        for name in sorted(states)
    }
    return {name: layout for name, layout in layouts.items() if layout is not None}


def _layout_on(hosts: Hosts, name: str, states: Mapping[str, State], groups: Sequence[Group]) -> AppliedLayout | None:
    """Return what runs on a host: these groups, and its own components; None where there are neither."""
    system, host = hosts.system, hosts.system.hosts[name]
    on_host = tuple(_host_components(hosts, name, tuple(sorted(states))))
    if not groups and not on_host:
        return None
    reserves = {
        partition_name(partition): guaranteed(partition.settings.reserve, partition.settings.processors)
        for partition in states[name].of(system.application.name).partitions
        if partition.settings.running
    }
    periods = {group.name: deadline_period_us(group, host) for group in groups}
    return AppliedLayout(
        application=system.application.name,
        host_processors=host.logical_processors,
        reserved=totals_after(states[name], system.application.name, (), ()).reserved_lp,
        partitions={group.name: group.members for group in groups},
        reserves={partition: float(processors) for partition, processors in reserves.items()},
        on_host=on_host,
        tasks=system.tasks,
        deadline_periods_us={group: period for group, period in periods.items() if period is not None},
    )


def _refuse_stopped(states: Mapping[str, State], application: str) -> None:
    """Refuse partitions that rarms stopped, before anything says that they are not applied: the user can start them.

    Raises:
        UseCaseError: There are some (refused).
    """
    stopped = sorted(
        partition.mark.name
        for state in states.values()
        for partition in state.of(application).partitions
        if partition.mark and partition.mark.stopped_by is not StoppedBy.NO_USER and not partition.settings.running
    )
    if stopped:
        message = f"These partitions were stopped by rarms: {', '.join(stopped)}."
        advice = prose("Start them, and prove again: ", command("start", *stopped), ".")
        finding = measuring_findings.NOT_APPLIED.at(
            None, message, advice, address=f"partition/{stopped[0]}", values={"partitions": tuple(stopped)}
        )
        raise UseCaseError(Outcome.REFUSED, [finding])


def _refuse_unapplied(hosts: Hosts, states: Mapping[str, State], everywhere: Mapping[str, State]) -> None:
    """Refuse hosts that a plan would change: only what manifest and data logs say now can be proven.

    Raises:
        UseCaseError: A plan would change something (refused), or the manifest cannot be planned (as `outcome_of`).
    """
    limits = PlanLimits(max_disruption=Disruption.REMOVAL)  # so that no change is held back and goes unseen
    plan = make_plan(hosts, plan_request(hosts.only(*sorted(states)), limits), everywhere)
    pending = [(str(change.address), part.host.name) for part in plan.hosts for change in part.changes]
    if pending:
        places = tuple(f"{address} on {host}" for address, host in pending)
        message = f"The manifest asks for something that is not applied yet: {', '.join(places)}."
        raise UseCaseError(Outcome.REFUSED, [_not_applied(message, pending[0][0], {"pending": places})])


def _host_components(hosts: Hosts, name: str, measurable: tuple[str, ...]) -> Iterator[Component]:
    """Yield the components of the host's own operating system; one that is allowed on several hosts is on the first."""
    for component in hosts.system.components.values():
        allowed = [each for each in measurable if component.hosts is None or each in component.hosts]
        if component.runs_on is RunsOn.HOST and allowed[:1] == [name]:
            yield component


def _measurable_hosts(hosts: Hosts) -> tuple[str, ...]:
    measurable = tuple(name for name in hosts.chosen if hosts.open_to_measure(name) is not None)
    if not measurable:
        message = f"rarms can run components on none of these hosts: {', '.join(hosts.chosen) or 'there are none'}."
        advice = "Run the components there by hand, and compare what they show with their thresholds."
        raise UseCaseError(
            Outcome.FAILED,
            [measuring_findings.CANNOT_MEASURE.at(None, message, advice, values={"hosts": tuple(hosts.chosen)})],
        )
    return measurable


def _not_applied(message: str, address: str, values: Facts) -> Diagnostic:
    advice = prose("See what is missing with ", PLAN, ", and bring it there with ", APPLY, ".")
    return measuring_findings.NOT_APPLIED.at(None, message, advice, address=address, values=values)


def _conditions(hosts: Hosts, state: State, name: str, request: ProveRequest) -> ProofConditions:
    """What the layout of this host is run under.

    Raises:
        UseCaseError: There is no room for the load (negative).
    """
    if request.interference is None:
        return ProofConditions(beside=None, seed=request.seed)
    budget = host_budget(hosts.system.hosts[name], state, hosts.system.application.name)
    beside = load_partition(hosts.system.interference[request.interference], budget)
    if beside is None:
        message = f"{name} has no memory left for a partition that holds {request.interference}."
        room = {"host": name, "interference": request.interference}
        finding = measuring_findings.NO_ROOM.at(None, message, "Prove without --interference.", values=room)
        raise UseCaseError(Outcome.NEGATIVE, [finding])
    return ProofConditions(beside=beside, seed=request.seed)


def _prove(
    session: MeasuringSession, name: str, layout: AppliedLayout, conditions: ProofConditions, listener: SampleListener
) -> LayoutProof | None:
    """Prove one host's layout; None where an end was asked for."""
    stop, manifest = session.control.stop, session.hosts.manifest
    answer = prove(session.held[name], layout, conditions, stop.should_stop, partial(listener, name))
    if isinstance(answer, TooManyFailures):
        component = answer.component
        message = f"{component} in the layout: {len(answer.failures)} samples failed: {answer.failures[0]}."
        place = manifest.places.key("components", component)
        advice = "Run it alone and mend what fails, or allow it: `run: { failures: 5 }`."
        values: Facts = {"component": component, "failed_samples": len(answer.failures)}
        finding = measuring_findings.FAILED_SAMPLES.at(place, message, advice, values=values)
        raise UseCaseError(Outcome.NEGATIVE, [finding], manifest.sources)
    return answer


def _not_met(hosts: Hosts, proofs: list[LayoutProof]) -> Iterator[Diagnostic]:
    for proof in proofs:
        for verdict in proof.not_met:
            name, index = verdict.measured.component, verdict.measured.index
            finding, advice = _finding_of(verdict)
            yield finding.at(
                hosts.manifest.places.value("components", name, "apt", index),
                f"{name} on {proof.host}: {show_index(verdict.measured)}, and its threshold is "
                f"{show_threshold(index_named(index), verdict.measured.threshold)}.",
                advice,
                address=f"component/{name}",
                values={**index_facts(verdict.measured), "host": proof.host},
            )


def _finding_of(verdict: IndexVerdict) -> tuple[Finding, Wording]:
    """Return the finding for a verdict that is not met, and the advice with it."""
    match verdict.verdict:
        case Unsteady():
            return (
                measuring_findings.NO_STEADY_STATE,
                "Look for what grows while it runs, or give it more: `--samples 2000`.",
            )
        case WithinNoise() | TooFewSamples() | TooManyFailures():
            return measuring_findings.NOT_RESOLVED, "Allow more samples (`--samples 2000`), or raise its reservation."
        case Met() | Missed():
            again = command("measure", verdict.measured.component, again=True, stop_partitions=True)
            return measuring_findings.MISSED, prose(
                "Raise its reservation, relax its APT, or measure it again: ", again, "."
            )
        case _:
            assert_never(verdict.verdict)
