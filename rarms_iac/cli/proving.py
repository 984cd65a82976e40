"""Proving from the command line: what is applied is found on the hosts, run, and told beside its thresholds."""

from collections.abc import Iterator, Mapping
from contextlib import suppress
from dataclasses import dataclass, replace
from math import isfinite
from pathlib import Path
from typing import assert_never

from rarms_iac import __version__
from rarms_iac.app.errors import Outcome, UseCaseError
from rarms_iac.app.hosts import Hosts, observe_host
from rarms_iac.app.requests import PlanLimits
from rarms_iac.app.wiring import open_bench
from rarms_iac.apply.prepare import prepare
from rarms_iac.cli.codes import ExitCode
from rarms_iac.cli.configuration import now
from rarms_iac.cli.experiments import refuse_unknown
from rarms_iac.cli.locks import held_configurations
from rarms_iac.cli.measuring import held_benches
from rarms_iac.cli.planning import Wish, outcome_of, request_of
from rarms_iac.cli.session import Session
from rarms_iac.cli.telling import tell
from rarms_iac.measuring import findings
from rarms_iac.measuring.findings import show_index, show_threshold
from rarms_iac.measuring.partitions import host_budget
from rarms_iac.measuring.prove import AppliedLayout, IndexVerdict, LayoutProof, has_memory_for_load, prove, with_samples
from rarms_iac.model.diagnostics import Diagnostic, Finding
from rarms_iac.model.measurement import Series
from rarms_iac.model.outcomes import Met, Missed, TooFewSamples, TooManyFailures, Unsteady, WithinNoise
from rarms_iac.model.state import State
from rarms_iac.model.system import Component, Disruption, RunsOn
from rarms_iac.planner.groups import groups_of
from rarms_iac.providers.measuring import MeasuringHost
from rarms_iac.storage.datalog.configuration import Proven, ProvenIndex, append_entry
from rarms_iac.storage.datalog.files import configuration_path
from rarms_iac.views.prove import proof_text, prove_json, sampled, verdict_of

USUAL_SEED = 1


@dataclass(frozen=True, slots=True, kw_only=True)
class ProveOptions:
    """What `rarms prove` was asked for."""

    interference: str | None = None
    samples: int | None = None
    seed: int = USUAL_SEED
    lock_timeout_ms: int = 0


def prove_layout(session: Session, hosts: Hosts, options: ProveOptions, *, as_json: bool) -> ExitCode:
    """Run all components where they are applied and tell every PI beside its APT; 4 where one is not shown to be met.

    Raises:
        UseCaseError: the manifest asks for what is not on the hosts, or a host is held (3); it cannot be planned (4); a
            host cannot run components (1).
    """
    if options.interference:
        refuse_unknown((options.interference,), hosts.system.interference, "interference")
    names = _able(hosts)
    proofs: list[LayoutProof] = []
    with held_benches(session, hosts, names, options.lock_timeout_ms) as benches, session.interrupts.gently():
        states = {name: bench.observe() for name, bench in benches.items()}
        everywhere = {**_seen_elsewhere(hosts, names), **states}
        layouts = applied_layouts(hosts, states, everywhere)
        _refuse_what_is_not_applied(hosts, states, everywhere)
        for name, layout in layouts.items():
            answer = _prove(session, hosts, benches[name], states[name], with_samples(layout, options.samples), options)
            if answer is None:
                session.terminal.talk("Stopped: nothing is proven, and nothing was changed.")
                return session.interrupts.asked or ExitCode.INTERRUPTED
            proofs.append(answer)
    with held_configurations(Path(hosts.folder)):
        _record(hosts, proofs, states)
    found = tuple(_not_met(hosts, proofs))
    tell(session.terminal, found, hosts.manifest.sources)
    against = options.interference
    if as_json:
        session.terminal.data(prove_json(proofs, against, found))
    else:
        session.terminal.show(proof_text(proofs, against))
    if left_out := _left_out(hosts, layouts):
        session.terminal.talk(f"Not proven, since they are on other hosts: {', '.join(left_out)}.")
    return ExitCode.NO if found else ExitCode.DONE


def _record(hosts: Hosts, proofs: list[LayoutProof], states: Mapping[str, State]) -> None:
    """Write every PI beside its APT into the configuration logs, whatever came of it."""
    for proof in proofs:
        application = proof.layout.application
        reserves = {
            partition.mark.name: partition.settings.reserve
            for partition in states[proof.host].of(application).partitions
            if partition.mark
        }
        where = {member.name: name for name, members in proof.layout.partitions.items() for member in members}
        everyone = tuple(one.name for one in proof.layout.components)
        for component in proof.layout.judged:
            entry = Proven(
                component=component.name,
                when=now(),
                rarms_version=__version__,
                host=proof.host,
                partition=where.get(component.name, ""),
                reserve=reserves.get(where.get(component.name, ""), 0),
                beside=tuple(one for one in everyone if one != component.name),
                indexes=tuple(_proven(one) for one in proof.verdicts if one.measured.component == component.name),
            )
            platform = hosts.system.hosts[proof.host].platform
            append_entry(configuration_path(Path(hosts.folder), platform, component.name), entry)


def _proven(tried: IndexVerdict) -> ProvenIndex:
    seen = tried.measured.estimate
    return ProvenIndex(
        index=tried.measured.index,
        threshold=show_threshold(tried.measured.index, tried.measured.threshold),
        value=seen.value if seen else None,
        lower=seen.lower if seen and isfinite(seen.lower) else None,
        upper=seen.upper if seen and isfinite(seen.upper) else None,
        met=tried.met,
        verdict=verdict_of(tried.verdict),
        error=tried.error,
    )


def _seen_elsewhere(hosts: Hosts, able: tuple[str, ...]) -> dict[str, State]:
    """What the other hosts look like, as far as they can be reached: partitions that are there are not missing here."""
    found: dict[str, State] = {}
    for name in sorted(set(hosts.system.hosts) - set(able)):
        with suppress(UseCaseError):
            found[name] = observe_host(hosts.open(name))
    return found


def _left_out(hosts: Hosts, layouts: Mapping[str, AppliedLayout]) -> tuple[str, ...]:
    proven = {name for layout in layouts.values() for name in layout.partitions}
    return tuple(group.name for group in groups_of(hosts.system) if group.name not in proven)


def applied_layouts(
    hosts: Hosts, states: Mapping[str, State], everywhere: Mapping[str, State]
) -> dict[str, AppliedLayout]:
    """By host what of the manifest runs there.

    Raises:
        UseCaseError: a partition is nowhere, or does not run (3).
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
    if absent := [group.name for group in groups if group.name not in running]:
        says = f"These partitions are on no host, or do not run: {', '.join(absent)}."
        raise UseCaseError(Outcome.REFUSED, [_not_applied(says, f"partition/{absent[0]}")])
    found: dict[str, AppliedLayout] = {}
    for name in sorted(states):
        partitions = {group.name: group.members for group in groups if running[group.name] == name}
        on_host = tuple(_on_host(hosts, name, tuple(sorted(states))))
        if partitions or on_host:
            found[name] = AppliedLayout(application=application, partitions=partitions, on_host=on_host)
    return found


def _refuse_what_is_not_applied(hosts: Hosts, states: Mapping[str, State], everywhere: Mapping[str, State]) -> None:
    """What is proven is what is applied: members, reservations and classes as the manifest and the logs have them now.

    Raises:
        UseCaseError: a plan would change something (3), or the manifest cannot be planned (4).
    """
    limits = PlanLimits(max_disruption=Disruption.REMOVAL)  # nothing is held back: all that differs is seen
    asked = request_of(hosts, Wish(limits=limits), everywhere)
    prepared = prepare(replace(asked, hosts=tuple(sorted(states))), everywhere)
    if prepared.plan is None:
        raise UseCaseError(outcome_of(prepared.findings), prepared.findings, hosts.manifest.sources)
    waiting = [f"{change.address} on {part.host.name}" for part in prepared.plan.hosts for change in part.changes]
    if waiting:
        says = f"The manifest asks for something that is not applied yet: {', '.join(waiting)}."
        raise UseCaseError(Outcome.REFUSED, [_not_applied(says, str(waiting[0]).partition(" ")[0])])


def _on_host(hosts: Hosts, name: str, able: tuple[str, ...]) -> Iterator[Component]:
    """Components of the host's own operating system; who may be on several is on the first."""
    for component in hosts.system.components.values():
        allowed = [each for each in able if component.hosts is None or each in component.hosts]
        if component.runs_on is RunsOn.HOST and allowed[:1] == [name]:
            yield component


def _able(hosts: Hosts) -> tuple[str, ...]:
    able = tuple(
        name
        for name in hosts.chosen
        if open_bench(hosts.system.hosts[name], hosts.folder, hosts.state_path(name)) is not None
    )
    if not able:
        says = f"None of these is a simulated host: {', '.join(hosts.chosen) or 'there are none'}."
        advice = "Run the components there by hand, and compare what they show with their thresholds."
        raise UseCaseError(Outcome.FAILED, [findings.CANNOT_MEASURE.at(None, says, advice)])
    return able


def _not_applied(says: str, address: str) -> Diagnostic:
    advice = "See what is missing with `rarms plan`, and bring it there with `rarms apply`."
    return findings.NOT_APPLIED.at(None, says, advice, address=address)


def _prove(
    session: Session,
    hosts: Hosts,
    bench: MeasuringHost,
    state: State,
    layout: AppliedLayout,
    options: ProveOptions,
) -> LayoutProof | None:
    """One host's layout; None where an end was asked for."""
    host = hosts.system.hosts[bench.name]
    room = host_budget(host, state, layout.application)
    load = hosts.system.interference[options.interference] if options.interference else None
    if load is not None and not has_memory_for_load(room):
        says = f"{bench.name} has no memory left for a partition that holds {options.interference}."
        raise UseCaseError(Outcome.NEGATIVE, [findings.NO_ROOM.at(None, says, "Prove without --interference.")])
    live = session.terminal.live_table()

    def looked(seen: Mapping[str, Series]) -> None:
        if live is not None:
            live.show(sampled(bench.name, seen))

    try:
        answer = prove(
            bench, layout, load, room, seed=options.seed, should_stop=session.interrupts.should_stop, looked=looked
        )
    finally:
        if live is not None:
            live.hide()
    if isinstance(answer, TooManyFailures):
        name = answer.component
        says = f"{name} in the layout: {len(answer.failures)} samples failed: {answer.failures[0]}."
        place = hosts.manifest.places.key("components", name)
        advice = "Run it alone and mend what fails, or allow it: `run: { failures: 5 }`."
        raise UseCaseError(Outcome.NEGATIVE, [findings.FAILED_SAMPLES.at(place, says, advice)], hosts.manifest.sources)
    return answer


def _not_met(hosts: Hosts, proofs: list[LayoutProof]) -> Iterator[Diagnostic]:
    for proof in proofs:
        for one in proof.not_met:
            name, index = one.measured.component, one.measured.index
            finding, advice = _told_as(one)
            yield finding.at(
                hosts.manifest.places.value("components", name, "apt", index),
                f"{name} on {proof.host}: {show_index(one.measured)}, and its threshold is "
                f"{show_threshold(index, one.measured.threshold)}.",
                advice,
                address=f"component/{name}",
            )


def _told_as(tried: IndexVerdict) -> tuple[Finding, str]:
    """Which finding a verdict is that is not met, and what to do about it."""
    match tried.verdict:
        case Unsteady():
            return findings.NO_STEADY_STATE, "Look for what grows while it runs, or give it more: `--samples 2000`."
        case WithinNoise() | TooFewSamples() | TooManyFailures():
            return findings.NOT_RESOLVED, "Allow more samples (`--samples 2000`), or raise its reservation."
        case Met() | Missed():
            again = f"`rarms undo`, then `rarms measure {tried.measured.component} --again`"
            return findings.MISSED, f"Raise its reservation, relax its APT, or measure it again: {again}."
        case _:
            assert_never(tried.verdict)
