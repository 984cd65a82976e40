"""What `rarms measure` leaves behind, made without measuring: data logs beside a manifest that is in a folder."""

from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import replace
from datetime import date
from pathlib import Path

from rarms_iac.app.data_logs import path_of, subject_of
from rarms_iac.manifest.load import load_system
from rarms_iac.model.host import SimulatedHost
from rarms_iac.model.series import Series
from rarms_iac.model.setting import Setting
from rarms_iac.model.system import System
from rarms_iac.planner.groups import groups_of
from rarms_iac.planner.reservations import depends_on_a_log, names_of
from rarms_iac.storage.datalog.files import append_setting, read_log
from rarms_iac.storage.datalog.identity import header_of, identity_of
from rarms_iac.storage.datalog.log import DataLog, Provenance, Recorded
from rarms_iac.storage.datalog.named_files import Files
from tests.builders_measured import a_bench, a_series, a_setting

TAKEN = Provenance(rarms_version="0", when="2026-01-01T00:00:00Z")
_AROUND = (1.0, -1.0, 0.5, -0.5, 0.0)
_JOBS = 2000


def steady(component: str, mean: float, jobs: int = _JOBS) -> Series:
    """Jobs of about this response time, one after the other, all successful."""
    return a_series(component, [mean + _AROUND[at % len(_AROUND)] for at in range(jobs)])


def leave_log(folder: Path, members: Sequence[str], settings: Iterable[Setting], *, build: int = 26100) -> Path:
    """Write data logs, one for each load, on the first host that the components may use; return the first path."""
    system, recorded = _system(folder), tuple(settings)
    usable = (name for name in system.hosts if all(system.components[each].may_run_on(name) for each in members))
    host = system.hosts[min(usable)]
    bench = replace(a_bench(), logical_processors=host.logical_processors, provider=host.provider, os_build=build)
    if isinstance(host.settings, SimulatedHost):
        bench = replace(bench, smt=host.settings.smt, scheduler=host.settings.scheduler_type)
    subjects = [subject_of(system, host, tuple(members), load) for load in system.loads_of(tuple(members))]
    for subject in subjects:
        path = path_of(folder, subject)
        path.unlink(missing_ok=True)
        header = header_of(subject, identity_of(subject, Files(folder).of(subject), {}), bench)
        for each in recorded:
            append_setting(path, header, Recorded(setting=each, provenance=TAKEN))
    return path_of(folder, subjects[0])


def the_log(path: Path) -> DataLog:
    """All records of a data log, below its last header."""
    file = read_log(path)
    assert file is not None, path
    *_, header = file.headers.values()
    return file.log_of(header, file.headers)


def add_setting(path: Path, setting: Setting) -> None:
    """Add a setting to a data log that was left."""
    append_setting(path, the_log(path).header, Recorded(setting=setting, provenance=TAKEN))


def rewrite_log(path: Path, change: Callable[[Recorded], Recorded]) -> None:
    """Have each setting of a data log say something else."""
    log = the_log(path)
    path.unlink()
    for recorded in log.recorded:
        append_setting(path, log.header, change(recorded))


def with_weak_load(recorded: Recorded) -> Recorded:
    """The setting, with a load that left processors idle."""
    return replace(recorded, provenance=replace(recorded.provenance, weak_load=True))


def leave_logs(folder: Path, least: Mapping[str, int]) -> None:
    """A log for every reservation that is to be measured: at so many per cent every threshold holds, below it none."""
    for group in filter(depends_on_a_log, groups_of(_system(folder))):
        members = names_of(group.members)
        reserve = max(least[name] for name in members)
        good = [replace(steady(name, 10.0), elapsed_ms=1000.0) for name in members]
        bad = [_late(name) for name in members]
        leave_log(folder, members, (a_setting(reserve - 1, *bad), a_setting(reserve, *good)))


def leave_curves(folder: Path, work_ms: float, reserves: Iterable[int]) -> None:
    """A log for every reservation that is to be measured: a job takes its work over what its partition reserves."""
    recorded = tuple(reserves)
    for group in filter(depends_on_a_log, groups_of(_system(folder))):
        members = names_of(group.members)
        steady_at = ((reserve, 100 * work_ms / reserve) for reserve in recorded)
        settings = [a_setting(reserve, *(steady(name, mean, 200) for name in members)) for reserve, mean in steady_at]
        leave_log(folder, members, settings)


def _late(component: str) -> Series:
    late = steady(component, 20_000.0)
    return replace(late, samples=tuple(replace(each, successful=False) for each in late.samples))


def _system(folder: Path) -> System:
    system = load_system(str(folder / "rarms.yaml"), today=date(2026, 1, 1)).system
    assert system is not None
    return system
