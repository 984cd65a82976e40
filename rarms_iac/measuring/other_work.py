"""Texts on who had the processor time, and on the clocks of messages: what a host counted apart from samples.

`work_of_settings` looks through the settings of an experiment, `weak_answer` reports loads that leave processors idle.
"""

import re
from collections import Counter
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import replace
from statistics import fmean
from typing import Any

from rarms_iac.app.hosts import Hosts
from rarms_iac.manifest.checks.measurement import advice_on_weak_loads
from rarms_iac.measuring.evidence import idle_share
from rarms_iac.measuring.findings import (
    BUSY_HOST,
    MEMORY_KILLS,
    MORE_MEMORY,
    OTHER_CLOCK,
    SIMULATED_TIME,
    THREADS,
    WEAK_ANSWER,
    WORK_OUTSIDE,
    why_out_of_memory,
)
from rarms_iac.model.capacity import shared_processors
from rarms_iac.model.commands import command, prose
from rarms_iac.model.diagnostics import Diagnostic, Places
from rarms_iac.model.experiment import Experiment
from rarms_iac.model.host import Host
from rarms_iac.model.loads import BUSY_LOOP, could_take_all
from rarms_iac.model.series import Series
from rarms_iac.model.setting import (
    ALL_PARTITIONS,
    LOAD_PARTITIONS,
    P1,
    P2,
    OutsideWork,
    Setting,
    SettingEvidence,
    ThreadsSeen,
    join_heard,
)
from rarms_iac.running.work_places import add_up
from rarms_iac.statistics.samples import response_times
from rarms_iac.texts.messages import in_a_row
from rarms_iac.texts.quantities import show_duration, show_processors

LEAST_USE = 1e-3
"""Processor time for each unit of response time: a component that uses less mostly waits."""

_ID = re.compile(r"[0-9a-f]{16,}")
"""The id of a container or of a transient unit in a group's name: each start has another."""

SAME_TIMES = 0.1
"""Mean response times that differ by at most this part do not change with CR."""

MOST_AHEAD_MS = 5.0
"""No message comes before its stamp; adjusting a clock moves it by less."""
MOST_BEHIND_MS = 10_000.0
"""So old are no data that a robot still acts on."""


def work_of_evidence(
    names: Sequence[str], evidence: Sequence[SettingEvidence], places: Places, others: Sequence[SettingEvidence]
) -> Iterator[Diagnostic]:
    """Find work outside of the components' groups, processes killed for memory, and messages of other clocks.

    Args:
        evidence: Counts of the host, of each setting or start; entries of one process and group are added up.
        others: the evidence whose other programs are named: of this command, with the components in partitions.
    """
    if escaped := [work for work in _outside(evidence) if work.component]:
        yield WORK_OUTSIDE.at(
            places.key("components", names[0]),
            "Processes of {_left} left their control group: {_processes:;}. The reservation does not apply to them.",
            'Start the work in the partition. Use --cgroup-parent "$RARMS_CGROUP_PARENT" for a container and --slice '
            "for a systemd unit.",
            **_facts_of_work(names, escaped),
            _left=in_a_row(sorted({work.component for work in escaped})),
        )
    if busy := [work for work in _outside(others) if not work.component]:
        yield BUSY_HOST.at(
            places.key("components", names[0]),
            "While {_names} ran, other programs used more processor time: {_processes:;}.",
            f"If one of these programs does the work of {in_a_row(names)}, start it in the same partition. "
            "Otherwise no action is needed.",
            **_facts_of_work(names, busy),
            _names=in_a_row(names),
        )
    killed = Counter[str]()
    for each in evidence:
        killed.update(each.out_of_memory)
    for component, count in sorted(killed.items()):
        yield MEMORY_KILLS.at(
            places.key("components", component),
            "{component}:{_kills}",
            MORE_MEMORY,
            address=f"component/{component}",
            component=component,
            killed_for_memory=count,
            _kills=why_out_of_memory(count),
        )
    threads = {name: seen for each in evidence for name, seen in each.threads.items()}
    for component, seen in sorted(threads.items()):
        yield _threads_without_priority(component, seen, places)
    yield from _messages_of_other_clocks(evidence, places)


def _outside(evidence: Sequence[SettingEvidence]) -> Sequence[OutsideWork]:
    return add_up(replace(work, group=_ID.sub("*", work.group)) for each in evidence for work in each.outside)


def _facts_of_work(names: Sequence[str], found: Sequence[OutsideWork]) -> dict[str, Any]:
    return {
        "address": f"component/{names[0]}",
        "components": tuple(names),
        "processes": tuple(work.name for work in found),
        "groups": tuple(work.group for work in found),
        "outside_cpu_ms": sum(work.cpu_ms for work in found),
        "_processes": tuple(map(_described, found)),
    }


def _threads_without_priority(component: str, seen: ThreadsSeen, places: Places) -> Diagnostic:
    refused = f" The kernel refused the priority to {seen.refused}." if seen.refused else ""
    unmatched = f" No thread has the name {in_a_row(seen.unmatched, 'or')}." if seen.unmatched else ""
    names = f" Its threads: {', '.join(seen.names)}." if seen.unmatched and seen.names else ""
    return THREADS.at(
        places.value("components", component, "task"),
        "{component}:{_sentences}",
        "Correct `threads`. The kernel keeps 15 characters of a name; see /proc/PID/task/*/comm."
        if seen.unmatched
        else "Run rarms as root, and give the control group a real-time budget: docs/task-classes.md.",
        address=f"component/{component}",
        component=component,
        unmatched=seen.unmatched,
        threads=seen.names,
        refused=seen.refused,
        _sentences=f"{unmatched}{names}{refused}",
    )


def _messages_of_other_clocks(evidence: Sequence[SettingEvidence], places: Places) -> Iterator[Diagnostic]:
    for component, heard in sorted(join_heard(evidence).items()):
        place = places.key("components", component, "run", "samples")
        if heard.simulated_time:
            yield SIMULATED_TIME.at(
                place,
                "{component}: use_sim_time is set, but rarms measures response times with the clock of this machine.",
                "Play bags at their recorded rate. Set use_sim_time to false to measure with the robot's sensors.",
                address=f"component/{component}",
                component=component,
            )
        elif heard.inputs and not -MOST_BEHIND_MS <= heard.ahead_ms <= MOST_AHEAD_MS:
            yield OTHER_CLOCK.at(
                place,
                (
                    "{component}: the stamps of {input} are {_away} {_side} the clock of this machine. rarms "
                    "therefore counts response times from the arrival of {input} here."
                ),
                "If another machine publishes {input}, synchronize the clocks. A bag file has old stamps.",
                address=f"component/{component}",
                component=component,
                input=heard.input,
                ahead_ms=heard.ahead_ms,
                _away=show_duration(abs(heard.ahead_ms)),
                _side="ahead of" if heard.ahead_ms > 0 else "behind",
            )


def work_of_settings(
    experiment: Experiment, settings: Sequence[Setting], now: Sequence[Setting], places: Places
) -> Iterator[Diagnostic]:
    """Find work outside of P1, components that wait, kills for memory and stamps of other clocks.

    Args:
        settings: All settings, with one load or several.
        now: Those that this command ran. Other programs are named only for these.
    """
    evidence, others = ([each.evidence for each in of if each.evidence is not None] for of in (settings, now))
    yield from work_of_evidence(experiment.setup.members, evidence, places, others)
    by_reserve: dict[str, dict[int, list[Series]]] = {}
    for setting in settings:
        if setting.evidence is not None:
            for series in setting.series:
                by_reserve.setdefault(series.component, {}).setdefault(setting.reserve, []).append(series)
    for name, series_at in sorted(by_reserve.items()):
        if (use := unused_time(series_at)) is not None:
            low, high = min(series_at), max(series_at)
            yield WORK_OUTSIDE.at(
                places.key("components", name),
                "{component} used {_shown} of processor time per second of response time. Its response times at "
                "{lowest} % and at {highest} % of its VPs are the same.",
                prose(
                    "Find the program or machine that does the work. A reservation does not help a component "
                    "that waits for another machine."
                ),
                address=f"component/{name}",
                component=name,
                cpu_ms_per_second=use * 1000,
                lowest=low,
                highest=high,
                _shown=_shown(use * 1000),
            )


def unused_time(series_at: Mapping[int, Sequence[Series]]) -> float | None:
    """Return the processor time for each unit of response time of a component that only waits.

    Returns:
        Less than `LEAST_USE`; None: it used more, a series has no `cpu_ms`, fewer than two reserves were measured, or
        its mean response times differ by more than `SAME_TIMES`.
    """
    used = answered = 0.0
    means = []
    for all_series in series_at.values():
        times = [time for series in all_series for time in response_times(series.samples)]
        if not times or any(series.cpu_ms is None for series in all_series):
            return None
        used += sum(series.cpu_ms or 0.0 for series in all_series)
        answered += sum(times)
        means.append(fmean(times))
    if len(means) < 2 or not answered or used >= LEAST_USE * answered:
        return None
    return used / answered if max(means) <= (1 + SAME_TIMES) * min(means) else None


def _shown(time_ms: float) -> str:
    return f"{time_ms:.2g} ms" if time_ms < 10 else f"{time_ms:.0f} ms"


def _described(work: OutsideWork) -> str:
    name = work.name if work.processes else "processes that ended"
    return f"{name}{f' in {work.group}' if work.group.strip('/') else ''} {_shown(work.cpu_ms)}"


LEAST_SHARE = 0.01
"""Part of the processor time from which a process or limit is listed."""

_LIMITS = {
    P1: "the limit of P1",
    P2: "the limit of P2",
    **{part: f"the limit of {part}" for part in LOAD_PARTITIONS[1:]},
    ALL_PARTITIONS: "the limit of all partitions",
}


def describe_idle(load: str, evidence: SettingEvidence, host: Host) -> str:
    """Describe the processor time that a load did not use, and the processes that used it.

    Returns:
        Sentences.
    """
    shared = shared_processors(host, host.logical_processors)
    whole_ms = evidence.elapsed_ms * float(shared)
    idle = f"{load} left {100 * idle_share(evidence, shared):.0f} % of {show_processors(shared)} idle."
    had = [
        f"{work.name}{f' in {work.group}' if work.group.strip('/') else ''} used {100 * work.cpu_ms / whole_ms:.0f} %"
        for work in evidence.others
        if work.cpu_ms >= LEAST_SHARE * whole_ms
    ]
    limits = [
        f"{_LIMITS[name]} stopped its threads for {show_duration(time_ms)} in total on all processors"
        for name, time_ms in sorted(evidence.throttled_ms.items())
        if name in _LIMITS and time_ms >= LEAST_SHARE * evidence.elapsed_ms
    ]
    reasons = [f"Of {show_processors(shared)}, {in_a_row(had)}."] if had else []
    reasons += [f"{reason[0].upper()}{reason[1:]}." for reason in limits]
    return " ".join((idle, *(reasons or ["The load was waiting. Neither another process nor a limit was the cause."])))


def weak_answer(
    hosts: Hosts, members: tuple[str, ...], idle: Mapping[str, SettingEvidence | None], host: Host
) -> Diagnostic:
    """Make the finding on a result whose loads leave processors idle.

    Args:
        hosts: The manifest, with the positions of its lines.
        idle: By load, the counts of a setting in which it left processors idle; None: no such setting.
    """
    loads = tuple(idle)
    seen = {name: evidence for name, evidence in idle.items() if evidence is not None}
    idle_loads = "".join(f" {describe_idle(name, evidence, host)}" for name, evidence in seen.items())
    facts: dict[str, Any] = {}
    for evidence in [*seen.values()][:1]:
        facts = {
            "idle_percent": 100 * idle_share(evidence, shared_processors(host, host.logical_processors)),
            "processes": tuple(work.name for work in evidence.others),
            "groups": tuple(work.group for work in evidence.others),
            "throttled_ms": sum(evidence.throttled_ms.values()),
        }
    again = BUSY_LOOP in loads and could_take_all(hosts.system.interference[BUSY_LOOP], host.logical_processors)
    measure = command("measure", *members, interference=BUSY_LOOP, together=len(members) > 1, again=again)
    advice = advice_on_weak_loads(hosts.system, host, members, loads, measure)
    return WEAK_ANSWER.at(
        hosts.manifest.places.key("components", members[0]),
        (
            "{loads:all} {_verb} use all the processor time that {components:all} left free on "
            "{host}.{_idle_loads} The reservation may be too small with other loads."
        ),
        prose(advice, " Or accept the result: --weak-load."),
        address=f"component/{members[0]}",
        components=tuple(members),
        loads=loads,
        host=host.name,
        _verb="did not" if idle_loads else "cannot",
        _idle_loads=idle_loads,
        **facts,
    )
