"""The finding on work that did not run in a component's partition, for `measure`, `prove`, `tune` and `run`."""

import re
from collections import Counter
from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import replace
from statistics import fmean

from rarms_iac.model.commands import prose
from rarms_iac.model.diagnostics import Diagnostic, Finding, Place, Places
from rarms_iac.model.experiment import Experiment
from rarms_iac.model.outcomes import TooManyFailures
from rarms_iac.model.series import Series
from rarms_iac.model.setting import OutsideWork, Setting, SettingEvidence
from rarms_iac.model.wording import in_a_row
from rarms_iac.running.work_places import add_up

MEMORY_KILLS = Finding.warning("RARMS394", "The kernel killed processes that needed more memory")
WORK_OUTSIDE = Finding.warning("RARMS393", "A component's work may run outside its partition")

LEAST_USE = 1e-3
"""Processor time for each unit of response time: a component that uses less mostly waits."""

_ID = re.compile(r"[0-9a-f]{16,}")
"""The id of a container or of a transient unit in a group's name: each start has another."""

SAME_TIMES = 0.1
"""Mean response times that differ by at most this part do not change with CR."""

MORE_MEMORY = "Raise `memory` of the component or of its partition, and try again."

_ADVICE = (
    'Start the work in the partition: a container with --cgroup-parent "$RARMS_CGROUP_PARENT", a unit of systemd with '
    "--slice. If these are other programs, stop them and try again."
)


def work_outside(
    members: Sequence[str], outside: Iterable[OutsideWork], place: Place | None, address: str
) -> Iterator[Diagnostic]:
    """Find the processes outside of the partitions that worked while components ran.

    Args:
        outside: From the evidence of settings; entries of one process and group are added up.
    """
    found = add_up(replace(each, group=_ID.sub("*", each.group)) for each in outside)
    if not found:
        return
    escaped = [work for work in found if work.component]
    others = [work for work in found if not work.component]
    sentences = []
    if escaped:
        names = in_a_row(sorted({work.component for work in escaped}))
        sentences.append(f"Processes of {names} left their group: {'; '.join(map(_described, escaped))}.")
    if others:
        sentences.append(
            f"While {in_a_row(members)} ran, processes outside used more processor time: "
            f"{'; '.join(map(_described, others))}. The reservation does not reach them."
        )
    yield WORK_OUTSIDE.at(
        place,
        " ".join(sentences),
        _ADVICE,
        address=address,
        values={
            "components": tuple(members),
            "processes": tuple(work.name for work in found),
            "groups": tuple(work.group for work in found),
            "outside_cpu_ms": sum(work.cpu_ms for work in found),
        },
    )


def why_out_of_memory(failed: TooManyFailures) -> str:
    """Explain that the kernel killed processes of a failed component.

    Returns:
        A space and a sentence; empty: it killed none.
    """
    return f" {_kills(failed.out_of_memory)}" if failed.out_of_memory else ""


def memory_kills(killed: Mapping[str, int], places: Places) -> Iterator[Diagnostic]:
    """Find components with processes that the kernel killed.

    Args:
        killed: Number of killed processes, by component.
    """
    for component, count in sorted(killed.items()):
        yield MEMORY_KILLS.at(
            places.key("components", component),
            f"{component}: {_kills(count)}",
            MORE_MEMORY,
            address=f"component/{component}",
            values={"component": component, "killed_for_memory": count},
        )


def _kills(count: int) -> str:
    killed = "1 process" if count == 1 else f"{count} processes"
    return f"The kernel killed {killed} of its partition, because the partition's memory was used up."


def work_of_evidence(names: Sequence[str], evidence: Sequence[SettingEvidence], places: Places) -> Iterator[Diagnostic]:
    """Find work outside of the components' groups, and processes killed for memory.

    Args:
        evidence: Counts of the host, of each setting or start.
    """
    outside = [work for each in evidence for work in each.outside]
    yield from work_outside(names, outside, places.key("components", names[0]), f"component/{names[0]}")
    killed = Counter[str]()
    for each in evidence:
        killed.update(each.out_of_memory)
    yield from memory_kills(killed, places)


def work_of_settings(experiment: Experiment, settings: Sequence[Setting], places: Places) -> Iterator[Diagnostic]:
    """Find work outside of P1, components that only wait, and kills for memory, in the settings of an experiment.

    Args:
        settings: All settings, with one load or several.
    """
    evidence = [setting.evidence for setting in settings if setting.evidence is not None]
    yield from work_of_evidence(experiment.setup.members, evidence, places)
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
                f"{name} used {_shown(use * 1000)} of processor time in each second of response time, and "
                f"its response times are the same at {low} % and at {high} % of its VPs.",
                prose("Find out where its work runs. A reservation does not shorten the wait for another machine."),
                address=f"component/{name}",
                values={"component": name, "cpu_ms_per_second": use * 1000, "lowest": low, "highest": high},
            )


def unused_time(series_at: Mapping[int, Sequence[Series]]) -> float | None:
    """Return the processor time for each unit of response time of a component that only waits.

    Args:
        series_at: Series of one component, by the reserve of the setting.

    Returns:
        Less than `LEAST_USE`; None: it used more, a series has no `cpu_ms`, fewer than two reserves were measured, or
        its mean response times differ by more than `SAME_TIMES`.
    """
    used = answered = 0.0
    means = []
    for all_series in series_at.values():
        times = [time for series in all_series for time in _response_times(series)]
        if not times or any(series.cpu_ms is None for series in all_series):
            return None
        used += sum(series.cpu_ms or 0.0 for series in all_series)
        answered += sum(times)
        means.append(fmean(times))
    if len(means) < 2 or not answered or used >= LEAST_USE * answered:
        return None
    return used / answered if max(means) <= (1 + SAME_TIMES) * min(means) else None


def _response_times(series: Series) -> list[float]:
    return [sample.response_ms for sample in series.samples if sample.response_ms is not None]


def _shown(time_ms: float) -> str:
    return f"{time_ms:.2g} ms" if time_ms < 10 else f"{time_ms:.0f} ms"


def _described(work: OutsideWork) -> str:
    name = work.name if work.processes else "processes that ended"
    return f"{name}{f' in {work.group}' if work.group else ''} {_shown(work.cpu_ms)}"
