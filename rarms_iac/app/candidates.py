"""The candidate graph of a manifest, with what the data logs of compounds say; nothing is measured."""

from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace

from rarms_iac.app.data_logs import Measurements, measured_reservations
from rarms_iac.app.errors import Outcome, UseCaseError
from rarms_iac.app.manifests import Manifest
from rarms_iac.measuring.setup import interference_of
from rarms_iac.model.diagnostics import has_errors
from rarms_iac.model.state import State
from rarms_iac.model.system import Host, PartitionWish, System
from rarms_iac.planner.combining.candidates import Candidates, Mask, Node, candidates_of, informed, nodes_of
from rarms_iac.planner.combining.guiding import Guide, guide_of
from rarms_iac.planner.combining.oracle import WHOLE, Asked, Members, coi_as_measured
from rarms_iac.planner.groups import Group, groups_of, may_share
from rarms_iac.planner.layout import plan_layout
from rarms_iac.planner.prediction.members import alone_in, predictor_of
from rarms_iac.planner.problem import by_name, problem_of
from rarms_iac.planner.reservations import NotMeasured, names_of, rests_on_a_log
from rarms_iac.storage.datalog.files import log_path


@dataclass(frozen=True, slots=True, kw_only=True)
class Drawn:
    """The graph, with the CR that each compound of it will probably need."""

    candidates: Candidates
    predicted: Mapping[Mask, int]


def candidates_in(measured: Measurements, manifest: Manifest) -> Drawn:
    """Every compound of the partitions that rest on data logs, on the first host by name that all of them may run on.

    Raises:
        UseCaseError: a reservation is not known, or no host may have them all (4).
    """
    known, guide = _known(measured, manifest)
    return Drawn(candidates=known, predicted=_predicted(guide, known.by_mask))


def unpredicted_nodes(measured: Measurements, manifest: Manifest) -> tuple[Node, ...]:
    """Return the same graph as nodes without predictions, which take longer than everything else.

    Raises:
        UseCaseError: as `candidates_in`.
    """
    known, _ = _known(measured, manifest)
    return nodes_of(known, {})


def _predicted(guide: Guide, masks: Iterable[Mask]) -> Mapping[Mask, int]:
    return {mask: told for mask in masks if (told := guide.predicted(mask)) is not None}


def _known(measured: Measurements, manifest: Manifest) -> tuple[Candidates, Guide]:
    system = measured.system
    reservations = measured_reservations(measured, {})
    problem = problem_of(system, reservations, {}, may_move=False)
    groups = [
        group for group in problem.groups if rests_on_a_log(group) and all(member.apt for member in group.members)
    ]
    host = next((one for one in by_name(system.hosts) if all(one.name in problem.claims[g.name] for g in groups)), None)
    if host is None:
        found = plan_layout(system, reservations, {}, manifest.places).findings
        raise UseCaseError(
            Outcome.NEGATIVE, [diagnostic for diagnostic in found if has_errors([diagnostic])], manifest.sources
        )
    cois = [coi_as_measured(group, problem.claims[group.name][host.name], reservations, host) for group in groups]
    candidates = candidates_of(cois, lambda names: _may_share(groups, names), most=WHOLE)
    known = informed(candidates, recorded_answers(measured, host, candidates, {}))
    return known, guide_of(known, predictor_of(alone_in(groups, reservations, host)))


def _may_share(groups: Sequence[Group], names: Members) -> bool:
    return may_share(*(group for group in groups if names_of(group.members)[0] in names))


def recorded_answers(
    measured: Measurements, host: Host, candidates: Candidates, states: Mapping[str, State]
) -> tuple[Asked, ...]:
    """What the data logs of compounds say that hold on this host, by the rule of a plan; `states`: as seen."""
    compounds = [candidate.coi.members for candidate in candidates.by_mask.values()]
    return tuple(asked for names in compounds for asked in _answers(measured, host, names, states))


def _answers(measured: Measurements, host: Host, names: Members, states: Mapping[str, State]) -> Iterator[Asked]:
    interference = interference_of(measured.system, names)
    if not log_path(measured.folder, host.platform, names, interference).is_file():
        return
    system = _together(measured.system, names)
    reservations = measured_reservations(replace(measured, system=system), states)
    group = next(one for one in groups_of(system) if set(names) == {member.name for member in one.members})
    log, least = reservations.log(group.members, host), reservations.least(group.members, host)
    if isinstance(log, NotMeasured):
        return
    for reserve in log.measured:
        enough = least is not None and reserve >= least.reserve
        yield Asked(members=names, reserve=reserve, worse=() if enough else names)


def _together(system: System, names: Members) -> System:
    """The manifest with these in one partition."""
    others = {name: request for name, request in system.partitions.items() if not set(request.components) & set(names)}
    return replace(system, partitions={**others, names[0]: PartitionWish(name=names[0], components=names)})
