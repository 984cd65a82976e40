"""The resources of a host for an experiment, and what is in its way there.

In: a session and an experiment. Out: the host's free resources, the parts of P2 that fit, and a refusal where the host
is busy. Begin at `available_on_host`; `stop_what_is_in_the_way` stops the application's own partitions.
"""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace

from rarms_iac.app.hosts import Hosts
from rarms_iac.app.use_case_errors import Outcome, UseCaseError
from rarms_iac.measuring.experiment_log import read_experiment_log
from rarms_iac.measuring.findings import OCCUPIED
from rarms_iac.measuring.partitions import (
    MeasuringResources,
    highest_reserve,
    host_resources,
    other_running_partitions,
    parts_that_fit,
)
from rarms_iac.measuring.session import MeasuringSession, refuse_what_cannot_run
from rarms_iac.measuring.stopping import stop_own_partitions, stopped_to_measure
from rarms_iac.measuring.strategies import Method, Sweep, is_of_paper
from rarms_iac.measuring.units import describe_missing_part
from rarms_iac.model.experiment import Experiment
from rarms_iac.model.quantities import ReservePercent
from rarms_iac.model.state import Partition
from rarms_iac.planner.groups import groups_of
from rarms_iac.providers.measuring import PartitionWork


@dataclass(frozen=True, slots=True, kw_only=True)
class Availability:
    """The resources of a host for an experiment, and the obstacles there."""

    resources: MeasuringResources
    running: tuple[Partition, ...]  # they run during the experiment, and rarms does not stop them
    highest_reserve: ReservePercent  # the highest CR that the host can give


def available_on_host(session: MeasuringSession, experiment: Experiment) -> Availability:
    """Look at the host; partitions of the application are stopped, unless it is to be measured with them."""
    observed = session.host_of(experiment).observe()
    state = observed if session.on_busy_host else stopped_to_measure(observed, experiment.application)
    resources = host_resources(experiment.host, state, experiment.application)
    return Availability(
        resources=resources,
        running=other_running_partitions(state),
        highest_reserve=highest_reserve(resources, experiment.setup),
    )


def resources_by_host(session: MeasuringSession, experiments: Sequence[Experiment]) -> dict[str, MeasuringResources]:
    """Look at each host of these experiments once."""
    by_host = {each.host.name: each for each in experiments}
    return {name: available_on_host(session, each).resources for name, each in by_host.items()}


def with_load_parts(
    session: MeasuringSession, experiment: Experiment, method: Method, resources: MeasuringResources
) -> Experiment:
    """Return the experiment with as many parts of P2 as its load has by this method, and as the host has memory for.

    A sweep and the paper's strategy have the paper's P2, in one part, unless settings with several are recorded: a plan
    goes by these, and theirs are to join them.

    Raises:
        UseCaseError: The data log is damaged (negative).
    """
    several = in_load_parts(experiment, resources)
    if several.load_parts > 1 and has_one_p2(method) and read_experiment_log(session, several).valid is None:
        return experiment
    return several


def has_one_p2(method: Method) -> bool:
    """Tell whether a method has the P2 of the paper: a sweep, and the paper's strategy."""
    return isinstance(method, Sweep) or is_of_paper(method)


def in_load_parts(experiment: Experiment, resources: MeasuringResources) -> Experiment:
    """Return the experiment with as many parts of P2 as a search has, and as the host has memory for."""
    parts = parts_that_fit(resources, experiment.usual_load_parts, experiment.setup.memory)
    return replace(experiment, load_parts=parts)


def describe_missing_parts(session: MeasuringSession, experiments: Sequence[Experiment]) -> Iterator[str]:
    """Yield a sentence for each host without memory for all partitions of some loads."""
    in_several = [each for each in experiments if each.usual_load_parts > 1]
    for host, resources in resources_by_host(session, in_several).items():
        in_parts = [in_load_parts(each, resources) for each in in_several if each.host.name == host]
        if loads := [each.setup.interference for each in in_parts if each.load_parts < each.usual_load_parts]:
            yield describe_missing_part(host, loads)


def stop_what_is_in_the_way(
    session: MeasuringSession, experiment: Experiment, method: Method, available: Availability | None = None
) -> None:
    """Refuse what cannot be measured, then stop what is in the way; nothing is run.

    `run_experiment` calls it only where the data log does not hold every setting already.

    Args:
        available: What was seen of the host; None: it is looked at now.

    Raises:
        UseCaseError: A member or a load cannot run on the host, or the host is as `_refuse_host` says; partitions of
            the application run, and may not be stopped (refused).
    """
    host = session.host_of(experiment)
    members = {member.name: member for member in experiment.members}
    refuse_what_cannot_run(session, host, components=members, loads={experiment.setup.interference: experiment.load})
    _refuse_host(session, experiment, method, available or available_on_host(session, experiment))
    if not session.on_busy_host:
        stop_own_partitions(session, host)


def _refuse_host(session: MeasuringSession, experiment: Experiment, method: Method, available: Availability) -> None:
    """Refuse a host that is busy, has reservations that the paper does not know, or has no room.

    Raises:
        UseCaseError: The host is not free to measure, or it has reservations that the paper does not know (refused);
            there is no room (negative).
    """
    host = experiment.host.name
    if available.running and not session.on_busy_host:
        running = tuple(partition.shown_name for partition in available.running)
        template = "Running partitions on {host} would change the measurement: {_names}."
        advice = "Stop these partitions. To measure anyway, add --on-busy-host; the data log records it."
        finding = OCCUPIED.of_host(host, template, advice, partitions=running, _names=", ".join(running))
        raise UseCaseError(Outcome.REFUSED, [finding])
    if is_of_paper(method) and not available.resources.unreserved:
        template = "Some processor time of {host} is reserved for the host or for other machines."
        advice = "Use the default strategy. Or stop other machines and set `keep_for_host: { processor: 0 % }`."
        raise UseCaseError(Outcome.REFUSED, [OCCUPIED.of_host(host, template, advice)])
    asked_reserve = max(method.reserves, default=0) if isinstance(method, Sweep) else 0
    if available.highest_reserve == 0 or asked_reserve > available.highest_reserve:
        advice = "Stop other machines, lower keep_for_host, or give the component less memory."
        if available.highest_reserve:
            advice = (
                f"Limit the measurement: `--to {available.highest_reserve}%`. Or stop other machines, or lower "
                "keep_for_host."
            )
        finding = OCCUPIED.of_host(
            host,
            (
                "P1, the partition of {_experiment}, can get at most {highest_reserve_percent} % of each of its "
                "{processors} processors on {host}. P2, the partition of the load, also needs memory."
            ),
            advice,
            highest_reserve_percent=available.highest_reserve,
            asked_reserve_percent=asked_reserve,
            processors=experiment.setup.processors,
            _experiment=experiment.name,
        )
        raise UseCaseError(Outcome.NEGATIVE, [finding])


def work_of_others(hosts: Hosts, running: Sequence[Partition]) -> Iterator[PartitionWork]:
    """Yield the work of the application's partitions that go on running, their components under names of their own.

    What other partitions run is not known: a simulated host has them idle.
    """
    application = hosts.system.application.name
    names = {
        partition.mark.name for partition in running if partition.mark and partition.mark.application == application
    }
    for group in groups_of(hosts.system):
        if group.name in names:
            members = tuple(
                replace(member, name=f"{member.name} in {group.name}")
                for member in group.members
                if member.simulation is not None
            )
            yield PartitionWork(partition=group.name, components=members)
