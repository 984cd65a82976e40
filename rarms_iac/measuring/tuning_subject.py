"""The subject of tuning: CoIs with their reservations, and the capacity of the hosts. Begin at `subject_of_tuning`."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

from rarms_iac.app.data_logs import measured_reservations
from rarms_iac.app.hosts import Hosts
from rarms_iac.app.use_case_errors import Outcome, UseCaseError
from rarms_iac.measuring.measure_request import loads_for
from rarms_iac.measuring.partitions import highest_reserve, host_resources
from rarms_iac.measuring.session import no_measurable_host
from rarms_iac.model.commands import command, prose
from rarms_iac.model.diagnostics import has_errors
from rarms_iac.model.experiment import Experiment, ProcessorNumber, ProcessorSource, experiments_of
from rarms_iac.model.host import Host
from rarms_iac.model.layout import Layout
from rarms_iac.model.state import State
from rarms_iac.model.system import Disruption, System
from rarms_iac.planner import planning_findings
from rarms_iac.planner.combining.candidates import Candidates, candidates_of
from rarms_iac.planner.combining.layouts import Objective
from rarms_iac.planner.combining.oracle import WHOLE, Coi, Members, coi_as_measured, processors_of
from rarms_iac.planner.groups import Group, may_share
from rarms_iac.planner.layout import plan_layout
from rarms_iac.planner.packing.pack import pack
from rarms_iac.planner.packing.values import Item, NoPacking, Packing, free_on, least_cost
from rarms_iac.planner.prediction import Predict, alone_in, predictor_of, unpredicted
from rarms_iac.planner.problem import Problem, problem_of, solve, system_around
from rarms_iac.planner.reservations import depends_on_a_log, names_of
from rarms_iac.storage.datalog.decisions import TuningStrategy


@dataclass(frozen=True, slots=True, kw_only=True)
class TuningSubject:
    """Measured partitions, on hosts of one platform, which tuning may combine."""

    hosts: Hosts
    host: Host  # where compounds are measured
    problem: Problem  # as it is planned now: the chosen hosts, and what shares them
    state: State  # of the host
    cois: tuple[Coi, ...]
    capacity: int  # of all hosts of the problem, in per cent of one logical processor
    fixed: int  # what partitions reserve that are not tuned, in the same unit
    predict: Predict = unpredicted

    @property
    def system(self) -> System:
        """What the manifest says."""
        return self.hosts.system

    @property
    def remaining(self) -> int:
        """What the CoIs may reserve together, in per cent of one logical processor.

        A CoI that reserves less on another host counts with what it reserves there.
        """
        tuned = {coi.name: coi.cost for coi in self.cois}
        less = sum(tuned[item.name] - least_cost(item) for item in self.problem.items if item.name in tuned)
        return max(0, self.capacity - self.fixed + less)

    def may_share(self, members: Members) -> bool:
        """Return whether these components may share a partition on some host, and be measured on the one tuned on.

        Returns:
            False too where the host has no room for them.
        """
        groups = [group for group in self.problem.groups if names_of(group.members)[0] in members]
        return may_share(*groups) and bool(self._homes(members)) and self.highest(members) > 0

    def highest(self, members: Members) -> int:
        """Return the highest CR that the host can give to a P1 of these components.

        Returns:
            Whole per cent of each of P1's processors; 0: it has no room.
        """
        first, *_ = self.experiments(members)
        return highest_reserve(host_resources(self.host, self.state, self.system.application.name), first.setup)

    def experiments(
        self, members: Members, strategy: TuningStrategy = "default", samples: int | None = None
    ) -> tuple[Experiment, ...]:
        """Return the experiments of these components together in P1, one for each load of their reservation.

        Args:
            members: the components, by sorted names.
            strategy: by which it is asked: the paper's knows one load.
            samples: how many of each component a setting takes; None: as its `run.until` says.

        Returns:
            Experiments that differ in nothing but the load; nothing is run.
        """
        loads = loads_for(self.system, members, strategy)
        parts = [coi for coi in self.cois if set(coi.members) <= set(members)]
        number = ProcessorNumber(number=processors_of(parts), source=ProcessorSource.MEMBERS)
        found = experiments_of(self.system, self.host, members, loads, samples)
        return tuple(each if each.fixes_processors else each.with_processors(number) for each in found)

    @property
    def most(self) -> int:
        """The highest CR that the host can give to each of them, in per cent of its processors."""
        return min((self.highest(coi.members) for coi in self.cois), default=WHOLE)

    def candidates(self) -> Candidates:
        """Return the compounds that the default strategy may measure, before anything is asked."""
        return candidates_of(self.cois, self.may_share, most=self.most)

    def objective(self, layout_fit: "LayoutFit") -> Objective:
        """Return the measure of a layout's worth here; `layout_fit` says which ones the hosts can keep.

        Args:
            layout_fit: asked for each layout that is considered.

        Returns:
            What the search compares layouts by.
        """
        return Objective(
            capacity=self.remaining,
            fits=layout_fit.fits,
            minimise=self.system.policy.minimise,
            criticalities={name: self.system.components[name].criticality for coi in self.cois for name in coi.members},
        )

    def packing_of(self, layout: Sequence[Coi]) -> Packing | NoPacking:
        """Place these components on the hosts, next to what is not tuned.

        Args:
            layout: CoIs that hold each tuned component once.

        Returns:
            The host of each partition; or that none exists, and whether that is proven.
        """
        tuned = {coi.name for coi in self.cois}
        others = [item for item in self.problem.items if item.name not in tuned]
        return pack([*others, *map(self._item, layout)], self.problem.bins)

    def _item(self, coi: Coi) -> Item:
        if coi in self.cois:
            return next(each for each in self.problem.items if each.name == coi.name)
        memory = sum(self.system.components[name].memory for name in coi.members)
        homes, now = self._homes(coi.members), self.problem.current_hosts.get(coi.name)
        # The partition of that name stays where it runs, as the others do.
        stays = now in homes and not self.problem.may_move
        claims = {
            name: self.problem.seen[name].sharing(coi.name).claim(coi.processors, coi.reserve, memory)
            for name in ((now,) if stays and now else homes)
        }
        return Item(name=coi.name, claims=claims, current_host=now or "")

    def _homes(self, members: Members) -> tuple[str, ...]:
        """Return the chosen hosts that all of these components may run on."""
        components = [self.system.components[each] for each in members]
        return tuple(name for name in self.hosts.chosen if all(each.may_run_on(name) for each in components))


@dataclass(slots=True, kw_only=True)
class LayoutFit:
    """Says which layouts fit, and remembers whether one was refused only because no placement was found for it."""

    subject: TuningSubject
    unsure: bool = False

    def fits(self, layout: Sequence[Coi]) -> bool:
        """Return whether the hosts can give these reservations; no, where no placement was found.

        The CoIs as they are fit exactly where a plan has a layout.

        Args:
            layout: CoIs that hold each tuned component once.

        Returns:
            True only where a placement was found.
        """
        if set(layout) == set(self.subject.cois) and isinstance(solve(self.subject.problem), Layout):
            return True
        packing = self.subject.packing_of(layout)
        self.unsure = self.unsure or (isinstance(packing, NoPacking) and not packing.proven)
        return isinstance(packing, Packing)


def subject_of_tuning(hosts: Hosts, host: Host, states: Mapping[str, State]) -> TuningSubject:
    """Return the subject of tuning: partitions with measured reservations, and the capacity that they may share.

    Args:
        states: What hosts look like, by name; with that of the host.

    Returns:
        CoIs by partition name; amounts in per cent of one logical processor.

    Raises:
        UseCaseError: A reservation is not measured, or the hosts are of several platforms (negative).
    """
    _refuse_several_platforms(hosts)
    problem = problem_around(hosts, states)
    reservations = problem.reservations
    if any(not problem.claims[group.name] for group in problem.groups):
        places = hosts.manifest.places
        diagnostics = plan_layout(problem.system, reservations, problem.states, places, explain=False).findings
        raise UseCaseError(
            Outcome.NEGATIVE,
            [diagnostic for diagnostic in diagnostics if has_errors([diagnostic])],
            hosts.manifest.sources,
        )
    groups = [group for group in problem.groups if _can_be_tuned(group, problem, host)]
    seen = problem.seen[host.name]
    cois = tuple(
        coi_as_measured(
            group, problem.claims[group.name][host.name], reservations, host, sharing=seen.sharing(group.name)
        )
        for group in groups
    )
    tuned = {coi.name for coi in cois}
    return TuningSubject(
        hosts=hosts,
        host=host,
        problem=problem,
        state=states[host.name],
        cois=cois,
        capacity=free_on(problem.bins).percent,
        fixed=sum(least_cost(item) for item in problem.items if item.name not in tuned),
        predict=predictor_of(alone_in(groups, reservations, host)),
    )


def problem_around(hosts: Hosts, states: Mapping[str, State]) -> Problem:
    """Return the problem that a plan solves for the chosen hosts and all partitions that share them.

    Args:
        states: What hosts look like, by name.

    Returns:
        The problem. Its system has no partition that neither is on these hosts nor can make room there.
    """
    system, reservations = hosts.system, measured_reservations(hosts.manifest, states)
    may_move = system.policy.max_disruption is Disruption.REMOVAL
    whole = problem_of(system, reservations, states, may_move=may_move)
    return problem_of(system_around(whole, hosts.chosen), reservations, states, may_move=may_move)


def _refuse_several_platforms(hosts: Hosts) -> None:
    names: dict[str, list[str]] = {}
    for name in sorted(hosts.chosen):
        names.setdefault(hosts.system.hosts[name].platform, []).append(name)
    platforms = sorted(names)
    if len(platforms) > 1:
        tunes = [piece for platform in platforms for piece in (", ", command("tune", host=names[platform][0]))]
        advice = prose(
            "Tune one platform after the other: ",
            *tunes[1:],
            ". If the hosts are alike, give them one platform: `platform: NAME`.",
        )
        raise UseCaseError(
            Outcome.NEGATIVE,
            [
                planning_findings.PLATFORMS.at(
                    None,
                    "The hosts have the platforms {platforms:each}, but a measurement is valid for only one platform.",
                    advice,
                    platforms=tuple(platforms),
                )
            ],
        )


def tuning_host(hosts: Hosts) -> Host:
    """Return the first of the chosen hosts that can be measured on.

    Returns:
        The host as the manifest describes it.

    Raises:
        UseCaseError: There is none (failed).
    """
    for name in hosts.chosen:
        if hosts.open_to_measure(name) is not None:
            return hosts.system.hosts[name]
    raise no_measurable_host(hosts, "Tune on a Linux host, or on a simulated host of the same platform: --host.")


def _can_be_tuned(group: Group, problem: Problem, host: Host) -> bool:
    """Return partitions to leave alone: their entries fix what they get.

    What is measured elsewhere would not hold there.
    """
    request = group.request
    own = request.memory is not None or request.processors is not None or request.cpu.limit is not None
    measured = depends_on_a_log(group) and all(member.apt for member in group.members)
    return measured and not own and request.cpu.weight is None and host.name in problem.claims[group.name]
