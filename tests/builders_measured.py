"""Measured things for tests: settings, headers and logs, by what a test is about."""

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import fields, replace
from typing import Any

from rarms_iac.app.report_model import ComponentProof
from rarms_iac.model.host import ProviderKind, SchedulerType
from rarms_iac.model.loads import BusyLoop, Interference
from rarms_iac.model.series import Sample, Series
from rarms_iac.model.setting import EnvironmentSetup, PlatformFacts, Setting
from rarms_iac.model.system import Component, TaskRequest
from rarms_iac.storage.datalog.decisions import Proven, ProvenIndex, TrailSetting, TunedPartition, TuningRun
from rarms_iac.storage.datalog.identity import LogSubject, header_of, identity_of
from rarms_iac.storage.datalog.log import DataLog, Header, Provenance, Recorded
from tests.builders import a_component, at_most, memory

TAKEN = Provenance(rarms_version="0.1", when="2027-01-31T12:00:00Z")


def a_series(component: str = "vision", responses: Iterable[float | None] = (90.0, 100.0)) -> Series:
    """One after the other; a job without an answer is a failed one."""
    samples, began = [], 0.0
    for each in responses:
        failure = "" if each is not None else "it died"
        samples.append(Sample(began_ms=began, response_ms=each, successful=each is not None, failure=failure))
        began += each or 0.0
    return Series(component=component, samples=tuple(samples), elapsed_ms=began, cpu_ms=began / 2)


def a_setting(reserve: int = 70, *series: Series) -> Setting:
    """A reservation of P1 with what was measured; P2 has the rest."""
    return Setting(reserve=reserve, series=series or (a_series(),), beside=100 - reserve, seed=7)


def a_bench() -> PlatformFacts:
    """The simulated host with two LPs that everything is tried on."""
    return PlatformFacts(
        provider=ProviderKind.SIMULATED,
        processor="simulated",
        logical_processors=2,
        smt=False,
        scheduler=SchedulerType.CLASSIC,
        guest_image="",
        os_build=26100,
    )


def a_subject(
    *components: Component,
    load: Interference | None = None,
    tasks: Mapping[str, TaskRequest] | None = None,
    platform: str = "onboard",
) -> LogSubject:
    """Components in P1 with two VPs against busy loops."""
    members = components or (a_component(),)
    return LogSubject(
        platform=platform,
        components=members,
        setup=EnvironmentSetup(
            members=tuple(member.name for member in members),
            interference="busy-loop",
            processors=2,
            memory=memory("512 MiB"),
            limit=100,
            weight=100,
        ),
        load=load or BusyLoop(),
        tasks=tasks or {},
    )


def a_header(subject: LogSubject | None = None, files: Mapping[str, str] | None = None) -> Header:
    """The header of a log of the subject."""
    chosen = subject or a_subject()
    return header_of(chosen, identity_of(chosen, files or {}, {}), a_bench())


def a_log(settings: Sequence[Setting], subject: LogSubject | None = None) -> DataLog:
    """A log of these settings."""
    return DataLog(
        header=a_header(subject), recorded=tuple(Recorded(setting=setting, provenance=TAKEN) for setting in settings)
    )


HELD = ProvenIndex(
    index="mean_response_time",
    threshold=at_most(100),
    value=97.5,
    lower=97.0,
    upper=98.0,
    met=True,
    verdict="met",
    error=0.01,
)
PROVEN = Proven(
    component="vision",
    when="2027-01-31T13:00:00Z",
    rarms_version="0",
    host="onboard",
    partition="vision",
    reserve=62,
    serial=3,
    beside=("speech",),
    indexes=(HELD,),
)
"""A proof of a threshold that held, as a configuration log has it."""


def a_proof(outdated: tuple[str, ...] = (), **changes: Any) -> ComponentProof:
    """Such a proof as a report has it: fields of the entry or of its index are changed."""
    usual = {"when": "2026-11-21T12:00:00Z", "reserve": 64, "partition": "", "beside": (), "serial": 0}
    entry = {**usual, "interference": "busy-loop", **changes}
    names = {part.name for part in fields(ProvenIndex)}
    of_index = {name: value for name, value in changes.items() if name in names}
    index = replace(HELD, **{"value": 90.0, "lower": None, "upper": 95.0, **of_index})
    of_entry = {name: value for name, value in entry.items() if name not in names}
    return ComponentProof(entry=replace(PROVEN, indexes=(index,), **of_entry), proven=index, outdated=outdated)


TUNED = TuningRun(
    when="2026-11-21T12:00:00Z",
    rarms_version="1",
    strategy="default",
    ending="successful",
    message="successful",
    capacity=200,
    before=228,
    after=194,
    proved=True,
    contradictions=(),
    partitions=(TunedPartition(name="path", components=("path", "stock"), processors=2, reserve=22, parts=78),),
    trail=(
        TrailSetting(components=("path", "stock"), reserve=30, worse=()),
        TrailSetting(components=("path", "stock"), reserve=21, worse=("path",)),
    ),
    written=True,
)
"""A tuning that combined two components."""
