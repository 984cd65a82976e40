"""The use scenario of the paper: the user picks a level of performance from a curve, sees what follows, refines it.

Afterwards, where the levels need more than there is, components are combined, if the user wants it:
`combine_if_wanted`.
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Protocol

from rarms_iac.app.control import Control
from rarms_iac.app.hosts import Hosts, observe_hosts
from rarms_iac.app.manifests import load_manifest
from rarms_iac.app.report import report_of_manifest
from rarms_iac.app.report_model import Report
from rarms_iac.app.select import BeyondMeasured, Selection, SelectRequest, select_level
from rarms_iac.app.use_case_errors import RequestError, UseCaseError
from rarms_iac.measuring.each_load import decisive, measure_with_each_load
from rarms_iac.measuring.measure_request import ExperimentResult, MeasureRequest, method_of, reserves_between
from rarms_iac.measuring.run_experiment import least_shown
from rarms_iac.measuring.session import MeasuringSession
from rarms_iac.measuring.stopping import stopped_to_measure
from rarms_iac.measuring.tune import TuneRequest, TuningPrompt, TuningResult, tune_components
from rarms_iac.measuring.tuning_subject import LayoutFit, TuningSubject, subject_of_tuning, tuning_host
from rarms_iac.model.experiment import Experiment, experiments_of
from rarms_iac.model.indexes import find_index
from rarms_iac.model.outcomes import Stopped, Swept
from rarms_iac.planner.combining.candidates import candidates_of
from rarms_iac.planner.combining.oracle import WHOLE, total
from rarms_iac.planner.combining.questions import expected
from rarms_iac.planner.planning_findings import NOT_MET, PLATFORMS, STALE, UNMEASURED


class SessionEnded(Exception):
    """The user asked for an end at a question; what was measured and written stays."""


class LevelPrompt(Protocol):
    """Asks the user for the level of performance that is good enough; on a terminal, or on a page.

    Every method that asks may raise `SessionEnded`.
    """

    def show(self, result: ExperimentResult, report: Report) -> None:
        """Show the user what was measured, before `ask`.

        Args:
            report: the data logs of its components, and what all reservations add up to on each platform.
        """

    def ask(self, component: str) -> str:
        """Return the level for a component, as `100 ms` or `p99_response_time 100 ms`; empty: go on without one.

        Returns:
            The answer without blanks around it; not checked yet.
        """

    def confirms(self, proposed: Selection) -> bool:
        """Show what would follow from the level, and tell whether it is written into the manifest.

        Args:
            proposed: as a dry run of `select_level` returns it.

        Returns:
            Whether it is written.
        """

    def refines(self, written: Selection) -> bool:
        """Tell whether to search for less, as nothing close below the reservation that follows was measured.

        Args:
            written: with at least one level that may do with less.

        Returns:
            Whether to measure.
        """

    def extends(self, beyond: BeyondMeasured) -> bool:
        """Tell whether to measure higher settings, since no measured one is enough for the level.

        Args:
            beyond: the level's error, with the settings in whole per cent.

        Returns:
            Whether to measure.
        """

    def refused(self, problem: RequestError | UseCaseError) -> None:
        """Tell why the level that was given cannot be had; the same component is asked again."""

    def written(self, outcome: Selection) -> None:
        """Tell what follows from the level, which now stands in the manifest."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Further:
    """The experiments of some components, one a load, which a level may ask more of."""

    session: MeasuringSession
    loads: Sequence[Experiment]
    request: MeasureRequest

    def measure(self, reserves: tuple[int, ...]) -> ExperimentResult:
        """Measure these settings; none: search for the thresholds that the manifest has now. Nothing is run twice."""
        fresh = self.session.hosts.reloaded()
        names, first = [before.setup.interference for before in self.loads], self.loads[0]
        again = experiments_of(fresh.system, first.host, first.setup.members, names, self.request.samples)
        method = method_of(replace(self.request, reserves=reserves, coarse=False))
        return decisive(measure_with_each_load(replace(self.session, hosts=fresh), again, method))


def ask_levels(further: Further, result: ExperimentResult, prompt: LevelPrompt) -> ExperimentResult:
    """Ask for a level of each component of an experiment, and write the answers into the manifest.

    Raises:
        SessionEnded: an end was asked for.

    Returns:
        The result with the thresholds that the manifest has then; what was searched for others is left out.
    """
    hosts = further.session.hosts
    source, names = hosts.manifest.source, result.experiment.setup.members
    prompt.show(result, report_of_manifest(hosts.manifest))
    for name in names:
        repeated = ""
        while level := repeated or prompt.ask(name):
            repeated = ""
            try:
                written = _selected(hosts, _request_of(name, level), prompt)
                if written is None:
                    continue
                prompt.written(written)
                if not any(level.may_be_less for level in written.levels) or not prompt.refines(written):
                    break
                result = further.measure(())
            except (RequestError, UseCaseError) as problem:
                prompt.refused(problem)
                extended = _extended(problem, prompt, further)
                if extended is None:
                    continue
                repeated, result = level, extended
            if isinstance(result.conclusion, Stopped):
                return result
            prompt.show(result, report_of_manifest(load_manifest(source)))
    return _judged_by_new_thresholds(hosts, result)


def _extended(problem: RequestError | UseCaseError, prompt: LevelPrompt, further: Further) -> ExperimentResult | None:
    """Return the result of higher settings, where the level needs them and the user wants them; else None."""
    if not isinstance(problem, BeyondMeasured) or not prompt.extends(problem):
        return None
    try:
        return further.measure(reserves_between(problem.first, problem.last, None))
    except UseCaseError as refusal:
        prompt.refused(refusal)
        return None


def _request_of(component: str, level: str) -> SelectRequest:
    """Read a level such as `100 ms`, with the index in front if the level alone does not say it."""
    index, _, rest = level.partition(" ")
    if find_index(index) is not None and rest:
        return SelectRequest(component=component, level=rest.strip(), index=index)
    return SelectRequest(component=component, level=level)


def _selected(hosts: Hosts, request: SelectRequest, prompt: LevelPrompt) -> Selection | None:
    """Return the level as it was written, once it was shown and confirmed; None: it was not wanted."""
    manifest = load_manifest(hosts.manifest.source)
    proposed = select_level(manifest, replace(request, dry_run=True))
    return select_level(manifest, request) if prompt.confirms(proposed) else None


def _judged_by_new_thresholds(hosts: Hosts, result: ExperimentResult) -> ExperimentResult:
    system = load_manifest(hosts.manifest.source).system
    before = result.experiment
    members = tuple(replace(member, apt=system.components[member.name].apt) for member in before.members)
    if members == before.members:
        return result
    experiment = replace(before, members=members)
    planned = least_shown(experiment, result.settings)
    return replace(result, experiment=experiment, conclusion=Swept(), planned=planned)


NO_SUBJECT = {finding.code for finding in (UNMEASURED, STALE, NOT_MET, PLATFORMS)}
"""Codes of findings with which there is nothing to combine yet; `plan` and `tune` tell of them."""


@dataclass(frozen=True, slots=True, kw_only=True)
class CombiningOffer:
    """All in per cent of one logical processor."""

    need: int  # what is reserved apart, by all partitions
    have: int
    predicted: int | None  # what would be reserved with the best single compound; None: none would save anything


class CombiningPrompt(TuningPrompt, Protocol):
    """Asks whether components are combined, which of them, and whether that is written."""

    def combines(self, offer: CombiningOffer) -> bool:
        """Show what is needed and what there is, and tell whether to combine.

        Args:
            offer: amounts in per cent of one logical processor.

        Returns:
            Whether the search begins.
        """


def combine_if_wanted(
    hosts: Hosts, request: TuneRequest, prompt: CombiningPrompt, control: Control
) -> TuningResult | None:
    """Offer to combine components where their reservations exceed the hosts, and write what is found and confirmed.

    Args:
        hosts: Of one platform, with the manifest as it is now.

    Returns:
        What tuning came to; None where nothing had to be combined, or it was not wanted.

    Raises:
        SessionEnded: The user asked for an end at a question.
        UseCaseError: As `tune_components`.
    """
    offer = combining_offer(hosts)
    if offer is None or not prompt.combines(offer):
        return None
    return tune_components(hosts, request, control, prompt)


def combining_offer(hosts: Hosts) -> CombiningOffer | None:
    """Work out whether the measured reservations exceed their hosts, and what one compound would probably save.

    Args:
        hosts: Of one platform; they are looked at.

    Returns:
        None where all fits, or where tuning has no subject yet: not all is measured, or the hosts differ in platform.

    Raises:
        UseCaseError: A host cannot be looked at (failed), or a data log is damaged (negative).
    """
    try:
        application = hosts.system.application.name
        states = {name: stopped_to_measure(state, application) for name, state in observe_hosts(hosts).items()}
        subject = subject_of_tuning(hosts, tuning_host(hosts), states)
    except UseCaseError as problem:
        if {finding.code for finding in problem.findings} <= NO_SUBJECT:
            return None
        raise
    need = total(subject.cois) + subject.fixed
    if LayoutFit(subject=subject).fits(subject.cois):
        return None
    return CombiningOffer(need=need, have=subject.capacity, predicted=_predicted(subject, need))


def _predicted(subject: TuningSubject, need: int) -> int | None:
    candidates = candidates_of(subject.cois, subject.may_share, most=WHOLE)
    saved = max(
        (
            total(candidates.members(mask)) - candidate.coi.taken_processors * reserve
            for mask, candidate in candidates.by_mask.items()
            if (reserve := expected(candidate, subject.predict)) is not None
        ),
        default=0,
    )
    return need - saved if saved > 0 else None
