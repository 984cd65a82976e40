"""The data of `rarms graph`: the layout as the manifest alone places it, and the candidate graph."""

from collections.abc import Iterator, Mapping
from dataclasses import dataclass, replace
from typing import Literal

from rarms_iac.app.data_logs import logs_of, measured_reservations, put_together
from rarms_iac.app.manifests import Manifest
from rarms_iac.app.use_case_errors import Outcome, UseCaseError
from rarms_iac.model.diagnostics import has_errors
from rarms_iac.model.host import Host
from rarms_iac.model.layout import Layout
from rarms_iac.model.output import Internal, output
from rarms_iac.model.state import State
from rarms_iac.model.system import System
from rarms_iac.planner.combining.candidates import Candidates, Node, candidates_of, informed, nodes_of
from rarms_iac.planner.combining.oracle import WHOLE, Members, coi_as_measured
from rarms_iac.planner.combining.questions import expected
from rarms_iac.planner.groups import may_share
from rarms_iac.planner.layout import plan_layout
from rarms_iac.planner.prediction import Predict, alone_in, predictor_of
from rarms_iac.planner.problem import by_name, problem_of
from rarms_iac.planner.reservations import depends_on_a_log, names_of
from rarms_iac.planner.verdicts import NotMeasured, with_curves
from rarms_iac.statistics.curves import components_not_shown, highest_missed
from rarms_iac.storage.datalog.decisions import TrailSetting


@dataclass(frozen=True, slots=True, kw_only=True)
class LayoutGraph:
    """Components by partition, and partitions by host."""

    kind: Literal["graph"] = "graph"
    application: str
    system: Internal[System]
    layout: Layout

    @output
    def hosts(self) -> Mapping[str, int]:
        """The LPs of each host, also of those that get nothing, by name."""
        return {host.name: host.logical_processors for host in by_name(self.system.hosts)}


@dataclass(frozen=True, slots=True, kw_only=True)
class CandidateGraph:
    """Components that could share a partition, parts before what consists of them."""

    kind: Literal["candidates"] = "candidates"
    application: str
    candidates: tuple[Node, ...]


def graph_of_manifest(manifest: Manifest) -> LayoutGraph:
    """Place all components as the manifest and its data logs alone say; no host is looked at.

    Args:
        manifest: with its data logs next to it.

    Returns:
        All hosts, with the partitions in the layout's order.

    Raises:
        UseCaseError: no layout (negative).
    """
    reservations = measured_reservations(manifest, {})
    planning = plan_layout(manifest.system, reservations, {}, manifest.places, explain=False)
    if not isinstance(planning.answer, Layout):
        raise UseCaseError(Outcome.NEGATIVE, planning.findings, manifest.sources)
    return LayoutGraph(application=manifest.system.application.name, system=manifest.system, layout=planning.answer)


def candidate_graph(manifest: Manifest, *, predict: bool) -> CandidateGraph:
    """Return the candidate graph: every compound of the partitions with measured reservations.

    Args:
        manifest: The graph is that of the first host by name that all of the components may run on.
        predict: Whether a compound that was not measured says what it will probably need; that takes longer than
            everything else.

    Returns:
        The CoIs and their compounds.

    Raises:
        UseCaseError: A reservation is not known, or no host may have them all (negative).
    """
    candidates, predict_need = _candidates(manifest)
    predicted = {
        mask: reserve
        for mask, candidate in candidates.by_mask.items()
        if predict and (reserve := expected(candidate, predict_need)) is not None
    }
    return CandidateGraph(application=manifest.system.application.name, candidates=nodes_of(candidates, predicted))


def _candidates(manifest: Manifest) -> tuple[Candidates, Predict]:
    system = manifest.system
    reservations = measured_reservations(manifest, {})
    problem = problem_of(system, reservations, {}, may_move=False)
    groups = [
        group for group in problem.groups if depends_on_a_log(group) and all(member.apt for member in group.members)
    ]
    shared = [
        host for host in by_name(system.hosts) if all(host.name in problem.claims[group.name] for group in groups)
    ]
    if not shared:
        findings = plan_layout(system, reservations, {}, manifest.places, explain=False).findings
        errors = [finding for finding in findings if has_errors([finding])]
        raise UseCaseError(Outcome.NEGATIVE, errors, manifest.sources)
    host = shared[0]
    cois = [coi_as_measured(group, problem.claims[group.name][host.name], reservations, host) for group in groups]
    group_of = {name: group for group in groups for name in names_of(group.members)}

    def may_all_share(names: Members) -> bool:
        return may_share(*{group_of[name].name: group_of[name] for name in names}.values())

    candidates = candidates_of(cois, may_all_share, most=WHOLE)
    informed_candidates = informed(candidates, recorded_answers(manifest, host, candidates, {}))
    return informed_candidates, predictor_of(alone_in(groups, reservations, host))


def recorded_answers(
    manifest: Manifest, host: Host, candidates: Candidates, states: Mapping[str, State]
) -> tuple[TrailSetting, ...]:
    """Return the answers of the valid data logs of compounds, by the rule of a plan.

    Args:
        manifest: The manifest, with its measurements next to it.
        states: Of hosts that were looked at: what was seen is compared with the logs, too.

    Returns:
        An answer for each setting of each compound, logs in the order of the compounds' names.
    """
    compounds = [candidate.coi.members for candidate in candidates.by_mask.values()]
    return tuple(answer for names in compounds for answer in _answers(manifest, host, names, states))


def _answers(manifest: Manifest, host: Host, names: Members, states: Mapping[str, State]) -> Iterator[TrailSetting]:
    if not all(path.is_file() for path in logs_of(manifest, host, names)):
        return
    system, group = put_together(manifest.system, names)
    reservations = measured_reservations(replace(manifest, system=system), states)
    log = reservations.log(group.members, host)
    if isinstance(log, NotMeasured):
        return
    apts = with_curves(group.members, log.curves)
    for reserve in log.measured:
        enough = log.least is not None and reserve >= log.least
        worse = () if enough else components_not_shown(apts, reserve)
        unresolved = bool(worse) and reserve > highest_missed(apts)
        yield TrailSetting(components=names, reserve=reserve, worse=worse, unresolved=unresolved)
