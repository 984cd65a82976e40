"""Checks of what is measured: thresholds (`apt`), data logs, and how a component is run and its samples are read."""

from collections.abc import Iterator, Mapping, Sequence
from fractions import Fraction
from math import ceil
from typing import Any

from rarms_iac.manifest.checks.violation import Violation, check, component_check, violation
from rarms_iac.model.commands import Prose, RecommendedCommand, command, prose
from rarms_iac.model.host import SCHEDULER_WINDOW_MS, Host, ProviderKind
from rarms_iac.model.indexes import SampleValue, find_index, index_named, percentile_of
from rarms_iac.model.loads import BUSY_LOOP, could_take_all
from rarms_iac.model.run import Call, Closed, Elapsed, Periodic, Run, SampleCount, Samples
from rarms_iac.model.series import MOST_SAMPLES
from rarms_iac.model.system import AtLeast, AtMost, Component, Measured, System, Threshold, run_of
from rarms_iac.running.reading import compile_pattern
from rarms_iac.statistics.distributions import samples_needed
from rarms_iac.statistics.steady_state import least_setting_ms
from rarms_iac.texts.findings import MISSING, WRONG_VALUE, Finding
from rarms_iac.texts.indexes import show_value
from rarms_iac.texts.messages import Suggestions
from rarms_iac.texts.quantities import plain, show_milliseconds, show_processors

TOO_FEW_SAMPLES = Finding.note("RARMS074", "A threshold needs more samples than a setting allows")


@component_check(MISSING)
def missing_to_measure(component: Component) -> Iterator[Violation]:
    """Find measured reserves without `apt` or start, and a miss rate without a deadline."""
    is_measured = component.cpu.reserve is Measured.MEASURED
    if is_measured and not component.apt:
        yield violation(
            ("components", component.name, "cpu", "reserve"),
            '"{component}" has `reserve: measured`, but no APT to meet.',
            "Add `apt`, or fix the reserve: `reserve: 20 %`.",
            reserve="measured",
        )
    if is_measured and component.run is None and component.simulation is None:
        yield violation(
            ("components", component.name),
            '"{component}" has a measured reserve, but the manifest does not define how to start it.',
            "Add `run` with a command, or `simulation` with its demand on a simulated host.",
            at_key=True,
            reserve="measured",
        )
    if "deadline_miss_rate" in component.apt and component.run is not None and component.run.deadline is None:
        yield violation(
            ("components", component.name, "apt", "deadline_miss_rate"),
            '"{component}" has a deadline_miss_rate but no deadline.',
            "Write `run.deadline`, or `run.arrival: { every: ... }`: the period is then the deadline.",
            at_key=True,
            index="deadline_miss_rate",
        )


@check(Finding.warning("RARMS325", "The loads leave processors idle"))
def weak_loads(system: System) -> Iterator[Violation]:
    """Find reservations whose loads cannot take all that P2 reserves."""
    for component in system.components.values():
        if component.cpu.reserve is not Measured.MEASURED:
            continue
        loads = system.loads_of([component.name])
        for host in system.hosts.values():
            if not component.may_run_on(host.name):
                continue
            if loads and not any(could_take_all(system.interference[name], host.logical_processors) for name in loads):
                own = ("components", component.name, "interference")
                measure = command("measure", component.name, interference=BUSY_LOOP)
                yield violation(
                    own if component.interference else ("policy", "interference"),
                    "{loads:all} cannot use all the processor time that {component} leaves free on the "
                    "{host_lp} LP of {host}. A reservation measured with them can be too small.",
                    advice_on_weak_loads(system, host, [component.name], loads, measure),
                    address=f"component/{component.name}",
                    component=component.name,
                    host=host.name,
                    loads=loads,
                    host_lp=host.logical_processors,
                )
                break


def advice_on_weak_loads(
    system: System, host: Host, members: Sequence[str], loads: Sequence[str], measure: RecommendedCommand
) -> Prose:
    """Return advice for loads that are too weak: a busy loop, unless the manifest's own is too weak itself.

    Args:
        members: names of components that run together, at least one.
        loads: names of the loads with which they are measured.
        measure: the command that measures them with a busy loop.
    """
    each = f"for each of the {show_processors(host.logical_processors)}"
    owner = f"components.{members[0]}" if system.components[members[0]].interference else "policy"
    if not could_take_all(system.interference[BUSY_LOOP], host.logical_processors):
        way = f"Make `interference.{BUSY_LOOP}` a busy loop without `threads`, which has one thread {each}"
    elif BUSY_LOOP in loads:
        way = (
            f"`{BUSY_LOOP}` has a thread {each}, but other work, a limit or an affinity kept it from using all "
            "processors. Find the cause"
        )
    elif BUSY_LOOP in system.loads_of(members):
        return prose(f"Measure with `{BUSY_LOOP}` as well, as in the manifest: ", measure, ".")
    else:
        way = f"Add `{BUSY_LOOP}` to `{owner}.interference`"
    return prose(f"{way}. Then measure with this load: ", measure, ".")


@component_check(WRONG_VALUE)
def no_sample_in_time(component: Component) -> Iterator[Violation]:
    """Find periodic components that are measured for less than one period."""
    match component.run:
        case Run(until=Elapsed(time=time), arrival=Periodic(period=period)) if time < period:
            here = ("components", component.name, "run")
            yield violation(
                (*here, "until"),
                '"{component}" is measured for {elapsed:ms}, but a job starts every {period:ms}.',
                "Measure for many periods: `until: { samples: 200 }`, or a longer `elapsed`.",
                related=(((*here, "arrival"), False, "the period"),),
                elapsed=time,
                period=period,
                component=component.name,
            )


@component_check(Finding.warning("RARMS069", "The time-out comes before the threshold"))
def timeout_before_threshold(component: Component) -> Iterator[Violation]:
    """Find time-outs at or below a deadline or a response time that would still be good enough."""
    if component.run is None:
        return
    for name, allowed in _allowed_times(component, component.run):
        if component.run.timeout <= allowed:
            yield violation(
                ("components", component.name, "run", "timeout"),
                'rarms stops "{component}" after {timeout:ms}, but its {allowed_by} allows {allowed:ms}. A '
                "late job would count as failed.",
                f"Raise the time-out well above {show_milliseconds(allowed)}.",
                timeout=component.run.timeout,
                allowed_by=name,
                allowed=allowed,
            )


def _allowed_times(component: Component, run: Run) -> Iterator[tuple[str, Fraction]]:
    if run.deadline is not None:
        yield "deadline", run.deadline
    for index, threshold in component.apt.items():
        if index.endswith("response_time") and isinstance(threshold, AtMost):
            yield index, threshold.value


@component_check(MISSING)
def index_without_field(component: Component) -> Iterator[Violation]:
    """Find indexes whose values no field of `run.samples` gives."""
    if (
        component.run is None
        or component.run.samples.source in {"per_run", "ros"}
        or isinstance(component.run.start, Call)
    ):
        return  # there the runner itself sees when a job starts, ends and fails
    for name in component.apt:
        missing = _missing_field(name, component.run.samples)
        if missing is not None:
            yield violation(
                ("components", component.name, "apt", name),
                'The {index} of "{component}" needs {_meaning}, but `run.samples` does not define a field for it.',
                f"Add `{missing.value}: {{ field: ... }}` to `run.samples`.",
                at_key=True,
                index=name,
                field=missing.value,
                _meaning=_FIELD_MEANING[missing],
            )


_FIELD_MEANING = {
    SampleValue.RESPONSE_TIME: "the response time of each job",
    SampleValue.SUCCESS: "the success of each job",
    SampleValue.COUNT: "the amount of work of each job",
}


def _missing_field(name: str, samples: Samples) -> SampleValue | None:
    """Return the field that this index needs and the samples lack, or None."""
    index = find_index(name)
    if index is None:
        return None
    has_no_field = samples.count is samples.success is samples.response_time is None
    is_missing = {
        SampleValue.RESPONSE_TIME: samples.response_time is None,
        SampleValue.SUCCESS: samples.success is None,
        SampleValue.COUNT: has_no_field,
    }
    return index.made_of if is_missing[index.made_of] else None


@check(TOO_FEW_SAMPLES)
def samples_not_to_be_had(system: System) -> Iterator[Violation]:
    """Find measured thresholds that need more samples than `run.until` or the budget allows."""
    for component in system.components.values():
        if component.cpu.reserve is Measured.MEASURED:
            between = _least_between(component)
            yield from _samples_not_taken(system, component, between)
            yield from _outlasts_budget(system, component, between)


def _samples_not_taken(system: System, component: Component, between: Fraction) -> Iterator[Violation]:
    """Find the threshold of a component that needs most samples, if a setting does not take so many."""
    budget = system.policy.measuring.setting
    run, here = run_of(component), ("components", component.name)
    needs = {index: samples_needed(index, threshold) for index, threshold in component.apt.items()}
    index = max(needs, key=lambda name: needs[name], default="")
    needed = needs.get(index, 0)
    facts: Mapping[str, Any] = {"index": index, "needs_samples": needed, "budget_ms": float(budget)}
    subject = 'The {index} of "{component}" needs at least {needs_samples} samples'
    if needed > MOST_SAMPLES:
        yield violation(
            (*here, "apt", index),
            f"{subject}, but a setting has at most {{most_samples}}. rarms cannot show that the threshold is met.",
            f"Relax the threshold: `{_strictest(index, component.apt[index])}`.",
            at_key=True,
            most_samples=MOST_SAMPLES,
            **facts,
        )
        return
    if needed and (takes_ms := _least_setting_ms(system, component, float(needed * between))) > budget:
        yield violation(
            (*here, "apt", index),
            f"{subject}. {_TAKES}",
            f"Raise the budget: {_budget(2 * takes_ms)}.",
            at_key=True,
            takes=takes_ms,
            loads=len(system.loads_of([component.name])),
            **facts,
        )
    if isinstance(run.until, SampleCount) and run.until.samples < needed:
        yield violation(
            (*here, "run", "until"),
            (
                f"{subject}. `--from` with `--to` and `--strategy paper` stop at {{samples}} samples. A search "
                "continues until its result is clear."
            ),
            f"For these options, allow more samples: `until: {{ samples: {needed} }}`.",
            related=(((*here, "apt", index), True, "the threshold"),),
            samples=run.until.samples,
            **facts,
        )


def _outlasts_budget(system: System, component: Component, between: Fraction) -> Iterator[Violation]:
    """Find `run.until` of a component that takes longer than the budget of a setting."""
    budget = system.policy.measuring.setting
    lasts = float(_least_until(run_of(component), between))
    if lasts and (takes_ms := _least_setting_ms(system, component, lasts)) > budget:
        yield violation(
            ("components", component.name, "run", "until"),
            f'"{{component}}" needs {{until:duration}} for `until`. {_TAKES}',
            f"Lower `until`: a setting continues until its result is clear. Or raise the budget: {_budget(takes_ms)}.",
            until=lasts,
            takes=takes_ms,
            loads=len(system.loads_of([component.name])),
            budget_ms=float(budget),
        )


def _strictest(index: str, threshold: Threshold) -> str:
    """Write the strictest threshold of this kind that as many samples show as a setting may have."""
    for hundredths in range(1, 100):
        bad = Fraction(hundredths, 100)
        if percentile_of(index) is not None:
            index = f"p{plain(100 - bad)}_response_time"
        else:
            threshold = AtLeast(value=100 - bad) if isinstance(threshold, AtLeast) else AtMost(value=bad)
        if find_index(index) is not None and samples_needed(index, threshold) <= MOST_SAMPLES:
            break
    found = index_named(index)
    return f"{index}: {{ {found.direction}: {show_value(found, threshold.value, threshold)} }}"


_TAKES = (
    "A setting with its {loads:load} then takes at least {takes:duration}, but has a budget of {budget_ms:duration}."
)


def _budget(least_ms: float) -> str:
    """Write the entry that gives a setting so much time."""
    return f"`policy: {{ measuring: {{ setting: {ceil(least_ms / 60_000)} min }} }}`"


def _least_setting_ms(system: System, component: Component, samples_ms: float) -> float:
    """Return the least duration of a setting with all loads of a component, on the host where that is least."""
    homes = component.hosts or tuple(system.hosts)
    begins_anew = all(system.hosts[name].provider is not ProviderKind.HYPERV for name in homes if name in system.hosts)
    return sum(
        least_setting_ms(
            samples_ms,
            system.interference[name],
            SCHEDULER_WINDOW_MS,
            is_periodic=isinstance(run_of(component).arrival, Periodic),
            begins_anew=begins_anew,
        )
        for name in system.loads_of([component.name])
    )


def _least_between(component: Component) -> Fraction:
    """Return the least time from one job to the next, in ms; 0: nothing says."""
    match run_of(component).arrival:
        case Periodic(period=period):
            return period
        case Closed():
            simulation = component.simulation
            return simulation.blocked + simulation.work / simulation.threads if simulation else Fraction(0)


def _least_until(run: Run, between: Fraction) -> Fraction:
    match run.until:
        case SampleCount(samples=samples):
            return samples * between
        case Elapsed(time=time):
            return time
        case None:
            return Fraction(0)


@check(WRONG_VALUE)
def pattern_is_not_re2(system: System) -> Iterator[Violation]:
    """Find patterns that google-re2 refuses, or that would take too much memory."""
    for component, samples in _with_pattern(system):
        groups = pattern_groups(samples.pattern)
        if isinstance(groups, str):
            yield violation(
                ("components", component.name, "run", "samples", "pattern"),
                'The pattern of "{component}" cannot be used: {reason}. Patterns are RE2, which has no '
                "back-references and no look-around.",
                "Remove back-references and look-around. Named groups are `(?P<name>...)`.",
                pattern=samples.pattern,
                reason=groups,
            )


@check(MISSING)
def pattern_without_group(system: System) -> Iterator[Violation]:
    """Find fields in `run.samples` that no named group of the pattern gives."""
    suggestions = Suggestions()
    for component, samples in _with_pattern(system):
        groups = pattern_groups(samples.pattern)
        fields = {"response_time": samples.response_time, "success": samples.success, "count": samples.count}
        for key, field in fields.items():
            if field is not None and not isinstance(groups, str) and field.field not in groups:
                similar, suggestion = suggestions.find(field.field, list(groups))
                yield violation(
                    ("components", component.name, "run", "samples", key, "field"),
                    'The pattern of "{component}" has no group "{group}".{_suggestion}',
                    f"Add `(?P<{field.field}>...)` to the pattern, or correct the name.",
                    field=key,
                    group=field.field,
                    similar=similar,
                    _suggestion=suggestion,
                )


def _with_pattern(system: System) -> Iterator[tuple[Component, Samples]]:
    for component in system.components.values():
        if component.run is not None and component.run.samples.source == "pattern":
            yield component, component.run.samples


def pattern_groups(pattern: str) -> Mapping[str, int] | str:
    """Return the named groups of an RE2 pattern with their numbers, or what is wrong with it."""
    import re2

    try:
        groups: Mapping[str, int] = compile_pattern(pattern).groupindex
    except re2.error as refused:
        reason = refused.args[0] if refused.args else "it is refused"
        return reason.decode("utf-8", "replace") if isinstance(reason, bytes) else str(reason)
    except UnicodeEncodeError:
        return "it contains half a character"
    return groups
