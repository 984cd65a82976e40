"""What `rarms measure` is asked for, as experiments: which components together, on which host, against which load."""

from collections.abc import Iterable, Iterator, Mapping
from dataclasses import dataclass
from fractions import Fraction
from typing import Literal

from rarms_iac.app.hosts import Hosts
from rarms_iac.app.requests import (
    argument,
    busy_host_option,
    flag,
    lock_timeout_option,
    option,
    refuse_unknown,
    samples_option,
)
from rarms_iac.app.use_case_errors import Outcome, RequestError, UseCaseError
from rarms_iac.measuring.evidence import MeasuredIndex, measured_indexes, shortfall_at
from rarms_iac.measuring.findings import UNABLE
from rarms_iac.measuring.other_work import weak_answer
from rarms_iac.measuring.strategies import PAPER, USUAL_STEP, Method, Search, Sweep
from rarms_iac.model.experiment import Experiment, ProcessorSource, experiments_of
from rarms_iac.model.host import Host, ProviderKind
from rarms_iac.model.loads import BUSY_LOOP, Browser, could_take_all
from rarms_iac.model.outcomes import (
    Conclusion,
    Condition,
    Missed,
    NotAchievable,
    NotResolved,
    SettingFailed,
    Stopped,
    Sufficient,
    Swept,
)
from rarms_iac.model.output import Internal, output
from rarms_iac.model.quantities import ReservePercent, guaranteed
from rarms_iac.model.series import HeardMessages, SkippedLines
from rarms_iac.model.setting import Setting, join_heard, join_skipped
from rarms_iac.model.system import RunsOn, System
from rarms_iac.planner.groups import groups_of
from rarms_iac.statistics.distributions import ERROR
from rarms_iac.texts.findings import MISSING
from rarms_iac.texts.messages import in_a_row

USUAL_SEED = 1
"""What chance is drawn from on a simulated host, unless a user says."""


@dataclass(frozen=True, slots=True, kw_only=True)
class MeasureRequest:
    """The request of `rarms measure`."""

    components: tuple[str, ...] = argument("[COMPONENT]...", default=())  # none: all with an APT
    together: bool = flag("--together", help="Measure the COMPONENTs in one partition. [default: each alone]")
    strategy: Literal["default", "bisection", "paper"] = option(
        "--strategy",
        help=(
            "How to search for the smallest reservation; paper: the paper's procedure with 10, 20, ... 100 %. "
            "[default: default]"
        ),
        default="default",
    )
    reserves: tuple[int, ...] = ()  # performance measurement mode; none: a search
    coarse: bool = False  # a coarse curve, as far as the host can give it, in place of a search
    interference: tuple[str, ...] = option(
        "--interference",
        metavar="NAME",
        help="Measure with this load; repeatable. [default: as in the manifest]",
        default=(),
    )
    samples: int | None = samples_option()
    seed: int | None = option("--seed", least=1, help="Seed of the random numbers; only settings with this seed count.")
    quick: bool = flag("--quick", help="Stop after the first pass. The reservations are provisional.")
    again: bool = flag("--again", help="Measure everything again; the logs keep earlier results.")
    weak_load: bool = flag(
        "--weak-load", help="Accept a result although the loads left processors idle; the log records it."
    )
    on_busy_host: bool = busy_host_option()
    attach: bool = flag(
        "--attach", help="Limit running services and containers while measuring (required without a terminal)."
    )
    lock_timeout_ms: int = lock_timeout_option()


ExperimentEnding = Literal["found", "not_achievable", "not_resolved", "no_verdict", "swept", "stopped"]


@dataclass(frozen=True, slots=True, kw_only=True)
class MeasuredSetting:
    """One reservation with what was measured there."""

    reserve: ReservePercent
    beside: int  # what P2 reserved meanwhile
    seed: int
    first_pass: bool  # its estimates have no bounds, and give no verdict
    indexes: tuple[MeasuredIndex, ...]
    disturbances: tuple[str, ...]  # on the host; a disturbed try is measured again, at most three times


@dataclass(frozen=True, slots=True, kw_only=True)
class ExperimentResult:
    """An experiment with its end."""

    experiment: Internal[Experiment]
    conclusion: Internal[Conclusion]
    settings: Internal[tuple[Setting, ...]]  # all that decide its end
    run_now: Internal[frozenset[ReservePercent]]  # those of them that this command ran, also in part
    planned: int | None  # what a plan reserves by the curve
    log: str  # path
    so_far: int | None = None  # what the loads before this one asked for, in per cent; None: it is the first
    of_loads: Internal[int] = 1  # with how many loads it was to be measured
    conditions: tuple[Condition, ...] = ()  # on which thresholds are met at the answer
    is_confirmed: Internal[bool] = False  # it was measured until no condition was left that more samples lift
    is_interrupted: Internal[bool] = False  # it has an answer, and an end was asked for while more was measured
    is_provisional: bool = False  # of the first pass: estimates without bounds, with one load
    is_weak: bool = False  # no answer: its loads left processors idle, and that was not wanted
    provisional_lp: Fraction | None = None  # what a plan reserves by the estimates of the first pass, with every load

    @output
    def new(self) -> int:
        """How many settings this command ran."""
        return len(self.run_now)

    @output
    def components(self) -> tuple[str, ...]:
        """Those that were measured together, by name."""
        return self.experiment.setup.members

    @output
    def host(self) -> str:
        """Where."""
        return self.experiment.host.name

    @output
    def host_lp(self) -> int:
        """LPs that the host has."""
        return self.experiment.host.logical_processors

    @output
    def platform(self) -> str:
        """What the result holds for."""
        return self.experiment.host.platform

    @output
    def processors(self) -> int:
        """VPs of P1, whose per cent each reserve is."""
        return self.experiment.setup.processors

    @output
    def processors_from(self) -> ProcessorSource:
        """Where that number comes from."""
        return self.experiment.processors_from

    @output
    def interference(self) -> str:
        """The load in P2."""
        return self.experiment.setup.interference

    @output
    def ending(self) -> ExperimentEnding:
        """How it ended."""
        match self.conclusion:
            case Sufficient():
                return "found"
            case NotAchievable():
                return "not_achievable"
            case NotResolved():
                return "not_resolved"
            case SettingFailed():
                return "no_verdict"
            case Swept():
                return "swept"
            case Stopped():
                return "stopped"

    @property
    def stopped(self) -> bool:
        """Whether an end was asked for, with or without an answer before."""
        return self.is_interrupted or isinstance(self.conclusion, Stopped)

    @property
    def found(self) -> Sufficient | None:
        """The answer; None: none was found, or looked for."""
        return self.conclusion if isinstance(self.conclusion, Sufficient) else None

    @output
    def reserve(self) -> ReservePercent | None:
        """The least that is enough."""
        return self.found.reserve if self.found else None

    @output
    def reserved_lp(self) -> Fraction | None:
        """What the least that is enough guarantees, in LPs."""
        return guaranteed(self.found.reserve, self.processors) if self.found else None

    @output
    def down_to_lp(self) -> Fraction | None:
        """The least that may be enough, in LPs; None: it saves no more than the precision of the policy."""
        least = self.found.down_to if self.found else None
        return None if least is None else guaranteed(least, self.processors)

    @output
    def failed(self) -> int | None:
        """The highest lower setting that is not enough, or is undecided."""
        return self.found.failed if self.found else None

    @output
    def undecided(self) -> bool:
        """Whether that one was not shown to be too little."""
        if self.failed is None:
            return False
        return not isinstance(shortfall_at(self.failed, self.settings, self.experiment), Missed)

    @output
    def inconclusive(self) -> tuple[int, ...]:
        """Settings above that one without a steady state: it is not known whether they are enough."""
        return self.found.inconclusive if self.found else ()

    @output
    def more_settings(self) -> int:
        """At most so many settings more would narrow the answer, or find one; 0: the search has its end."""
        return self.conclusion.more_settings if isinstance(self.conclusion, Sufficient | NotResolved) else 0

    @output
    def error(self) -> float | None:
        """How probably the answer is wrong; None: there is none."""
        has_error = isinstance(self.conclusion, Sufficient | NotAchievable) and not (
            self.is_weak or self.is_provisional
        )
        return ERROR if has_error else None

    @output
    def skipped_lines(self) -> Mapping[str, SkippedLines]:
        """Lines of real components that were not samples, by component, of all settings."""
        return join_skipped(setting.evidence for setting in self.settings)

    @output
    def heard_messages(self) -> Mapping[str, HeardMessages]:
        """The messages that samples come from, by component, of all settings."""
        return join_heard(setting.evidence for setting in self.settings)

    @output
    def measured(self) -> tuple[MeasuredSetting, ...]:
        """Each setting with its indexes."""
        return tuple(
            MeasuredSetting(
                reserve=setting.reserve,
                beside=setting.beside,
                seed=setting.seed,
                first_pass=setting.first_pass,
                indexes=measured_indexes(setting, self.experiment),
                disturbances=setting.evidence.disturbances if setting.evidence else (),
            )
            for setting in self.settings
        )


def settings_of(results: Iterable[ExperimentResult]) -> tuple[list[Setting], list[Setting]]:
    """Return the settings of these results, and those of them that this command ran."""
    pairs = [(result, setting) for result in results for setting in result.settings]
    return [each for _, each in pairs], [each for result, each in pairs if each.reserve in result.run_now]


def experiments_of_request(hosts: Hosts, request: MeasureRequest) -> tuple[Experiment, ...]:
    """Return the experiments of a request: each partition's components on one host of each platform.

    Args:
        hosts: Those of the manifest; the chosen ones are looked at in name order.

    Returns:
        In the order in which components are named; where none is named, the most critical first. Of the same
            components on the same host one a load, one after the other.

    Raises:
        RequestError: The request contradicts itself; a name is not in the manifest, or its component has no partition.
        UseCaseError: No host of theirs can be measured on (failed), or no component has an APT (negative).
    """
    system = hosts.system
    _refuse_contradictions(request)
    refuse_unknown(request.components, system.components, "component")
    refuse_unknown(request.interference, system.interference, "interference")
    for name in request.components:
        if system.components[name].runs_on is RunsOn.HOST:
            message = f"{name} runs on the host itself. Only components in a partition have a reservation."
            raise RequestError(message)
    is_named = bool(request.components) or request.coarse
    if not is_named and not any(component.apt for component in system.components.values()):
        raise _nothing_to_measure(hosts)
    experiments: list[Experiment] = []
    for members in _members(hosts, request):
        loads = tuple(dict.fromkeys(request.interference or loads_for(system, members, request.strategy)))
        if refuses_weak_loads(request):
            _refuse_weak(hosts, members, loads)
        for host in _hosts_to_measure_on(hosts, members):
            experiments += experiments_of(system, host, members, loads, request.samples)
    if (names := attached_of(hosts, request)) and not request.attach:
        message = (
            f"{in_a_row(names)} already {'runs' if len(names) == 1 else 'run'}. Measuring slows "
            f"{'it' if len(names) == 1 else 'them'} down."
        )
        raise RequestError(message, "Confirm with --attach. rarms restores the settings afterwards.")
    return tuple(experiments)


def attached_of(hosts: Hosts, request: MeasureRequest) -> tuple[str, ...]:
    """Return the components of a request that run already, on hosts where they would be slowed down, by name."""
    if not any(hosts.system.hosts[name].provider is ProviderKind.LINUX for name in hosts.chosen):
        return ()
    components = [hosts.system.components[name] for members in _members(hosts, request) for name in members]
    return tuple(sorted({each.name for each in components if each.run is not None and each.run.attach is not None}))


def refuses_weak_loads(request: MeasureRequest) -> bool:
    """Tell whether what is measured with weak loads is not an answer; a sweep and the paper's procedure take it."""
    return isinstance(method_of(request), Search) and request.strategy != PAPER and not request.weak_load


def _refuse_weak(hosts: Hosts, members: tuple[str, ...], loads: tuple[str, ...]) -> None:
    """Refuse to search with loads that cannot use all that P2 reserves; a browser is allowed.

    Raises:
        UseCaseError: The request does not allow weak loads (negative).
    """
    system = hosts.system
    described = [system.interference[name] for name in loads]
    for host in _hosts_to_measure_on(hosts, members):
        is_weak = not any(could_take_all(load, host.logical_processors) for load in described)
        if is_weak and not any(isinstance(load, Browser) for load in described):
            raise UseCaseError(
                Outcome.NEGATIVE, [weak_answer(hosts, members, dict.fromkeys(loads), host)], hosts.manifest.sources
            )


def loads_for(system: System, members: tuple[str, ...], strategy: str) -> tuple[str, ...]:
    """List the loads with which components are measured together.

    Args:
        strategy: The paper knows one load at a time: of several, the busy loop.

    Returns:
        Names, in the order in which they are measured.
    """
    loads = system.loads_of(members)
    return (BUSY_LOOP,) if strategy == PAPER and len(loads) > 1 else loads


def _refuse_contradictions(request: MeasureRequest) -> None:
    if request.together and len(set(request.components)) < 2:
        raise RequestError("--together needs at least two COMPONENTs.")
    if request.reserves and request.strategy != "default":
        raise RequestError("--strategy cannot be combined with --from, --to or --step.")
    if request.again and request.seed is not None:
        raise RequestError("--again cannot be combined with --seed.")
    if request.quick and not has_passes(request):
        raise RequestError("--quick cannot be combined with --again, --strategy paper, --from or --to.")


def reserves_between(first: int | None, last: int | None, step: int | None) -> tuple[int, ...]:
    """Return the settings of the performance measurement mode.

    Args:
        first: The lowest CR in per cent; None: 10.
        last: The highest, which is always measured; None: 100.
        step: How far apart they are; None: 10.

    Returns:
        Ascending, each once; none where nothing was given.

    Raises:
        RequestError: The last lies below the first.
    """
    if first is None and last is None and step is None:
        return ()
    begin, end = first or USUAL_STEP, last or 100
    if end < begin:
        raise RequestError(f"--to {end}% is below --from {begin}%.")
    return tuple(dict.fromkeys((*range(begin, end + 1, step or USUAL_STEP), end)))


def method_of(request: MeasureRequest) -> Method:
    """Return the way to choose settings: a sweep where reserves or a coarse curve are asked for, else by the options.

    Args:
        request: one that does not contradict itself.
    """
    if request.reserves or request.coarse:
        return Sweep(reserves=() if request.coarse else request.reserves)
    return Search(strategy=request.strategy)


def has_passes(request: MeasureRequest) -> bool:
    """Tell whether a first pass comes before the others; range mode and the paper's strategy have none."""
    return isinstance(method_of(request), Search) and request.strategy != PAPER and not request.again


def describe_request(request: MeasureRequest) -> str:
    """Describe what distinguishes a command from others of the same components.

    Returns:
        Words such as `default; 200 samples`; equal requests have equal words.
    """
    words: str = request.strategy
    if request.reserves:
        words = ", ".join(f"{reserve} % of its VPs" for reserve in request.reserves)
    return words if request.samples is None else f"{words}; {request.samples} samples"


def _nothing_to_measure(hosts: Hosts) -> UseCaseError:
    advice = (
        "Add a threshold: `apt: { mean_response_time: { at_most: 50 ms } }`. Or measure chosen settings "
        "with --from and --to."
    )
    place = hosts.manifest.places.key("components")
    return UseCaseError(
        Outcome.NEGATIVE,
        [MISSING.at(place, "No component has an `apt`. rarms needs thresholds to find a reservation.", advice)],
        hosts.manifest.sources,
    )


def _members(hosts: Hosts, request: MeasureRequest) -> tuple[tuple[str, ...], ...]:
    if request.components and request.together:
        return (tuple(sorted(set(request.components))),)
    if request.components:
        return tuple((name,) for name in dict.fromkeys(request.components))
    groups = sorted(groups_of(hosts.system), key=lambda group: (-group.criticality, group.name))
    to_measure = [group for group in groups if request.coarse or any(member.apt for member in group.members)]
    return tuple(tuple(member.name for member in group.members) for group in to_measure)


def _hosts_to_measure_on(hosts: Hosts, members: tuple[str, ...]) -> Iterator[Host]:
    """Yield the first host of each platform that all of them may run on and that can be measured on."""
    system = hosts.system
    allowed = [
        system.hosts[name]
        for name in hosts.chosen
        if all(system.components[member].may_run_on(name) for member in members)
    ]
    able = [host for host in allowed if hosts.can_run_on(host.name)]
    if not able:
        names = ", ".join(host.name for host in allowed) or "none"
        raise UseCaseError(
            Outcome.FAILED,
            [
                UNABLE.at(
                    None,
                    (
                        "rarms cannot measure {components:each} on these hosts: {_names}. It measures on "
                        "simulated hosts, Linux hosts, and Hyper-V hosts with `hyperv.credential`."
                    ),
                    "Choose another host with --host, or measure on a simulated host of the same platform.",
                    address=f"component/{members[0]}",
                    components=tuple(members),
                    hosts=tuple(host.name for host in allowed),
                    _names=names,
                )
            ],
        )
    platforms = dict.fromkeys(host.platform for host in able)
    yield from (next(host for host in able if host.platform == platform) for platform in platforms)
