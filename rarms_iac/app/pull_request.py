"""What a reviewer of a pull request needs beside its plan: headroom of APTs, changed data logs, changed scripts."""

import os
from collections.abc import Iterator, Mapping
from dataclasses import dataclass, replace
from math import inf
from pathlib import Path
from typing import Literal

from rarms_iac.app.data_logs import measured_reservations
from rarms_iac.app.hosts import Hosts, select_hosts
from rarms_iac.app.manifests import Manifest, load_manifest
from rarms_iac.app.planning import plan, plan_request
from rarms_iac.app.requests import ManifestSource, PlanLimits
from rarms_iac.app.scripts import PlanScript, compare_scripts, plan_scripts
from rarms_iac.app.use_case_errors import RequestError, UseCaseError
from rarms_iac.model.host import Host
from rarms_iac.model.layout import PlacedPartition
from rarms_iac.model.plan import Plan
from rarms_iac.model.system import AtMost, Threshold
from rarms_iac.planner.groups import Group, groups_of
from rarms_iac.planner.measured_together import NotMeasured
from rarms_iac.planner.reservations import MeasuredReservations, depends_on_a_log
from rarms_iac.planner.sizes import size
from rarms_iac.powershell.outline import ScriptDifference
from rarms_iac.storage.datalog.named_files import file_digest


@dataclass(frozen=True, slots=True, kw_only=True)
class AptHeadroom:
    """How far a measured performance index lies from its threshold at the planned reservation."""

    component: str
    index: str
    threshold: Threshold
    expected: float  # on the safe side of its band
    share: float  # of the threshold that is left; 0: it is just met


LogUse = int | Literal["not enough", "not used"]
"""The least CR by a data log, in per cent of the partition's own processors; or why there is none."""


@dataclass(frozen=True, slots=True, kw_only=True)
class LogChange:
    """A data log that is added, changed or no longer used, or from which another CR follows."""

    path: str  # below the manifest's folder
    before: LogUse
    after: LogUse


@dataclass(frozen=True, slots=True, kw_only=True)
class PlanReview:
    """A plan with what a reviewer compares it with."""

    plan: Plan
    headrooms: tuple[AptHeadroom, ...]  # the least first
    logs: tuple[LogChange, ...]  # by path; none without a base
    scripts: Mapping[str, ScriptDifference]  # by name; none without a base
    new_scripts: tuple[str, ...]  # names of those that the base's plan does not have
    without_base: str  # why nothing is compared; empty: it was


def review_for_pull_request(hosts: Hosts, made: Plan, limits: PlanLimits, base: str | None) -> PlanReview:
    """Gather what a reviewer needs. Starts nothing, and asks no host that the plan did not ask.

    Args:
        hosts: as the plan was made with.
        limits: how far it may go.
        base: the folder of a checkout before the change, seen from here as the manifest's path is; None: there is none.

    Returns:
        The plan with what changed against the base, as far as that has a manifest and a plan.
    """
    reservations = measured_reservations(hosts.manifest, {})
    headrooms = sorted(
        _headrooms(hosts, made, reservations), key=lambda headroom: (headroom.share, headroom.component, headroom.index)
    )
    review = PlanReview(
        plan=made,
        headrooms=tuple(headrooms),
        logs=(),
        scripts={},
        new_scripts=(),
        without_base="no checkout of the base was given (--base)",
    )
    if base is None:
        return review
    try:
        before = _in_base(hosts, base)
        logs = tuple(_log_changes(before.manifest, hosts.manifest))
    except (UseCaseError, RequestError) as problem:
        return replace(review, without_base=f"the base has no manifest that could be read: {problem}")
    try:
        old = _apply_scripts(plan(before, plan_request(before, limits)))
    except UseCaseError as problem:
        return replace(review, logs=logs, without_base=f"the base has no plan: {problem}")
    new = _apply_scripts(made)
    return replace(
        review,
        logs=logs,
        scripts={name: compare_scripts(old[name], script) for name, script in new.items() if name in old},
        new_scripts=tuple(name for name in new if name not in old),
        without_base="",
    )


def _headrooms(hosts: Hosts, made: Plan, reservations: MeasuredReservations) -> Iterator[AptHeadroom]:
    places = {name: part.host for part in made.hosts for name in part.components}
    for group in filter(depends_on_a_log, groups_of(hosts.system)):
        if group.name in places:
            yield from _headrooms_of(group, places[group.name], reservations)


def _headrooms_of(group: Group, host: Host, reservations: MeasuredReservations) -> Iterator[AptHeadroom]:
    log, partition = reservations.log(group.members, host), size(group, host, reservations)
    if isinstance(log, NotMeasured) or not isinstance(partition, PlacedPartition):
        return
    reserve = min(partition.settings.reserve * partition.settings.processors / log.processors, log.measured[-1])
    for member in group.members:
        for index, threshold in member.apt.items():
            expected, bound = log.curves(member.name, index).safe_value_at(reserve), float(threshold.value)
            if expected is not None:
                better = bound - expected if isinstance(threshold, AtMost) else expected - bound
                yield AptHeadroom(
                    component=member.name,
                    index=index,
                    threshold=threshold,
                    expected=expected,
                    share=better / bound if bound else (inf if better > 0 else 0.0),
                )


def _in_base(hosts: Hosts, base: str) -> Hosts:
    """These hosts and snapshots, with the manifest of the base."""
    source = hosts.manifest.source

    def path(file: str) -> str:
        return str(Path(base) / os.path.relpath(file))

    before = ManifestSource(
        manifest=path(source.manifest), overlays=tuple(map(path, source.overlays)), today=source.today
    )
    manifest = load_manifest(before)
    selection = replace(
        hosts.selection,
        hosts=tuple(name for name in hosts.selection.hosts if name in manifest.system.hosts),
        snapshots=tuple(each for each in hosts.selection.snapshots if each.host in ("", *manifest.system.hosts)),
    )
    return select_hosts(manifest, selection)


def _log_changes(before: Manifest, after: Manifest) -> Iterator[LogChange]:
    old, new = _logs_of(before), _logs_of(after)
    for path in sorted(old.keys() | new.keys()):
        before_use, after_use = old.get(path, _UNUSED), new.get(path, _UNUSED)
        if before_use != after_use:
            yield LogChange(path=path, before=before_use[0], after=after_use[0])


_UNUSED: tuple[LogUse, str] = ("not used", "")


def _logs_of(manifest: Manifest) -> dict[str, tuple[LogUse, str]]:
    """What follows from each data log that the manifest's partitions rest on, and the digest of the log."""
    reservations = measured_reservations(manifest, {})
    found: dict[str, tuple[LogUse, str]] = {}
    for group in filter(depends_on_a_log, groups_of(manifest.system)):
        for host in manifest.system.hosts.values():
            log = reservations.log(group.members, host)
            if not isinstance(log, NotMeasured):
                least = reservations.least(group.members, host)
                digest = file_digest(manifest.folder / log.path)
                found[log.path] = ("not enough" if least is None else least, digest)
    return found


def _apply_scripts(made: Plan) -> dict[str, PlanScript]:
    return {script.name: script for script in plan_scripts(made) if not script.undo}
