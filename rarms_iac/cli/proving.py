"""Proving from the command line: what is applied is found on the hosts, run, and told beside its thresholds."""

from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from math import isfinite
from pathlib import Path

from rarms_iac import __version__
from rarms_iac.cli.codes import ExitCode
from rarms_iac.cli.configuration import now
from rarms_iac.cli.experiments import refuse_unknown
from rarms_iac.cli.hosts import Hosts
from rarms_iac.cli.measuring import held_benches
from rarms_iac.cli.problems import Halted
from rarms_iac.cli.session import Session
from rarms_iac.cli.telling import tell
from rarms_iac.cli.wiring import open_bench
from rarms_iac.datalog.configuration import Proven, ProvenIndex, append_entry
from rarms_iac.datalog.paths import configuration_path
from rarms_iac.experiments import findings
from rarms_iac.experiments.measured import Shown
from rarms_iac.experiments.proving import AppliedLayout, Proof, has_room, prove, with_samples
from rarms_iac.experiments.room import room_of
from rarms_iac.experiments.telling import show_measured, show_threshold
from rarms_iac.experiments.watching import TooManyFailed
from rarms_iac.model.diagnostics import Diagnostic
from rarms_iac.model.measurement import Series
from rarms_iac.model.state import State
from rarms_iac.model.system import Component, RunsOn
from rarms_iac.planner.groups import groups_of
from rarms_iac.providers.measuring import MeasuringHost
from rarms_iac.views.proved import proof_text, prove_json, sampled

USUAL_SEED = 1


@dataclass(frozen=True, slots=True, kw_only=True)
class ProveOptions:
    """What `rarms prove` was asked for."""

    interference: str | None = None
    samples: int | None = None
    seed: int = USUAL_SEED
    lock_timeout_ms: int = 0


def prove_layout(session: Session, hosts: Hosts, options: ProveOptions, *, as_json: bool) -> ExitCode:
    """Run all components where they are applied and tell every PI beside its APT; 4 where one is missed.

    Raises:
        Halted: the layout is not on the hosts, or a host is held (3); a host cannot run components (1).
    """
    if options.interference:
        refuse_unknown((options.interference,), hosts.system.interference, "interference")
    names = _able(hosts)
    proofs: list[Proof] = []
    with held_benches(session, hosts, names, options.lock_timeout_ms) as benches, session.interrupts.gently():
        states = {name: bench.observe() for name, bench in benches.items()}
        layouts = applied_layouts(hosts, states)
        for name, layout in layouts.items():
            answer = _prove(session, hosts, benches[name], states[name], with_samples(layout, options.samples), options)
            if answer is None:
                session.terminal.talk("Stopped: nothing is proven, and nothing was changed.")
                return session.interrupts.asked or ExitCode.INTERRUPTED
            proofs.append(answer)
    _record(hosts, proofs, states)
    missed = tuple(_missed(hosts, proofs))
    tell(session.terminal, missed, hosts.opened.loaded.sources)
    against = options.interference
    session.terminal.data(prove_json(proofs, against, missed) if as_json else proof_text(proofs, against))
    return ExitCode.NO if missed else ExitCode.DONE


def _record(hosts: Hosts, proofs: list[Proof], states: Mapping[str, State]) -> None:
    """Write every PI beside its APT into the configuration logs, whatever came of it."""
    for proof in proofs:
        application = proof.layout.application
        reserves = {
            one.mark.name: one.settings.reserve for one in states[proof.host].of(application).partitions if one.mark
        }
        where = {one.name: name for name, members in proof.layout.partitions.items() for one in members}
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
                indexes=tuple(_proven(one) for one in proof.shown if one.component == component.name),
            )
            platform = hosts.system.hosts[proof.host].platform
            append_entry(configuration_path(Path(hosts.folder), platform, component.name), entry)


def _proven(one: Shown) -> ProvenIndex:
    seen = one.estimate
    return ProvenIndex(
        index=one.index,
        threshold=show_threshold(one.index, one.threshold),
        value=seen.value if seen else None,
        lower=seen.lower if seen and isfinite(seen.lower) else None,
        upper=seen.upper if seen and isfinite(seen.upper) else None,
        met=not one.misses,
    )


def applied_layouts(hosts: Hosts, states: Mapping[str, State]) -> dict[str, AppliedLayout]:
    """By host what of the manifest runs there.

    Raises:
        Halted: a partition is nowhere, or does not run (3).
    """
    system = hosts.system
    application = system.application.name
    running = {
        one.mark.name: name
        for name, state in states.items()
        for one in state.of(application).partitions
        if one.mark and one.settings.running
    }
    groups = groups_of(system)
    if absent := [group.name for group in groups if group.name not in running]:
        raise Halted(ExitCode.REFUSED, [_not_applied(absent)])
    found: dict[str, AppliedLayout] = {}
    for name in sorted(states):
        partitions = {group.name: group.members for group in groups if running[group.name] == name}
        on_host = tuple(_on_host(hosts, name, tuple(sorted(states))))
        if partitions or on_host:
            found[name] = AppliedLayout(application=application, partitions=partitions, on_host=on_host)
    return found


def _on_host(hosts: Hosts, name: str, able: tuple[str, ...]) -> Iterator[Component]:
    """Components of the host's own operating system; who may be on several is on the first."""
    for one in hosts.system.components.values():
        allowed = [each for each in able if one.hosts is None or each in one.hosts]
        if one.runs_on is RunsOn.HOST and allowed[:1] == [name]:
            yield one


def _able(hosts: Hosts) -> tuple[str, ...]:
    able = tuple(
        name
        for name in hosts.chosen
        if open_bench(hosts.system.hosts[name], hosts.folder, hosts.state_path(name)) is not None
    )
    if not able:
        says = f"None of these is a simulated host: {', '.join(hosts.chosen) or 'there are none'}."
        advice = "Run the components there by hand, and compare what they show with their thresholds."
        raise Halted(ExitCode.FAILED, [findings.CANNOT_MEASURE.at(None, says, advice)])
    return able


def _not_applied(absent: list[str]) -> Diagnostic:
    return findings.NOT_APPLIED.at(
        None,
        f"These partitions are on no host, or do not run: {', '.join(absent)}.",
        "See what is missing with `rarms plan`, and bring it there with `rarms apply`.",
        address=f"partition/{absent[0]}",
    )


def _prove(
    session: Session,
    hosts: Hosts,
    bench: MeasuringHost,
    state: State,
    layout: AppliedLayout,
    options: ProveOptions,
) -> Proof | None:
    """One host's layout; None where an end was asked for."""
    host = hosts.system.hosts[bench.name]
    room = room_of(host, state, layout.application)
    load = hosts.system.interference[options.interference] if options.interference else None
    if load is not None and not has_room(room):
        says = f"{bench.name} has no memory left for a partition that holds {options.interference}."
        raise Halted(ExitCode.NO, [findings.NO_ROOM.at(None, says, "Prove without --interference.")])
    terminal = session.terminal

    def looked(seen: Mapping[str, Series]) -> None:
        if terminal.lively:
            terminal.status(sampled(bench.name, seen, terminal.width))

    answer = prove(
        bench, layout, load, room, seed=options.seed, should_stop=session.interrupts.should_stop, looked=looked
    )
    if terminal.lively:
        terminal.status(sampled("", {}, terminal.width))
    if isinstance(answer, TooManyFailed):
        name = answer.component
        says = f"{name} in the layout: {len(answer.failures)} samples failed: {answer.failures[0]}."
        place = hosts.opened.loaded.places.key("components", name)
        advice = "Run it alone and mend what fails, or allow it: `run: { failures: 5 }`."
        raise Halted(ExitCode.NO, [findings.FAILED_SAMPLES.at(place, says, advice)], hosts.opened.loaded.sources)
    return answer


def _missed(hosts: Hosts, proofs: list[Proof]) -> Iterator[Diagnostic]:
    for proof in proofs:
        for one in proof.missed:
            yield findings.MISSED.at(
                hosts.opened.loaded.places.value("components", one.component, "apt", one.index),
                f"{one.component} on {proof.host}: {show_measured(one)}, and its threshold is "
                f"{show_threshold(one.index, one.threshold)}.",
                f"Measure it again (`rarms measure {one.component} --again`), raise its reservation, or relax its APT.",
                address=f"component/{one.component}",
            )
