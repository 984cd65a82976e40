"""The chosen hosts as the doctor is shown them: their States, and what else was seen there."""

from collections.abc import Iterator

from rarms_iac.apply.doctor.examination import Examination
from rarms_iac.cli.files import read_file
from rarms_iac.cli.hosts import Hosts, observed
from rarms_iac.cli.wiring import seen_in
from rarms_iac.model.condition import HostCondition
from rarms_iac.model.diagnostics import Diagnostic
from rarms_iac.planfile.snapshot import MAX_BYTES, SnapshotUnreadable


def examinations(hosts: Hosts) -> Iterator[Examination]:
    """Every chosen host, by name.

    Raises:
        Halted: one of them cannot be reached or read.
    """
    states = observed(hosts)
    files = {one.host or hosts.chosen[0]: one.file for one in hosts.where.snapshots}
    for name in hosts.chosen:
        condition, told = _seen(files.get(name), name)
        place = hosts.opened.loaded.places.key("hosts", name)
        yield Examination(state=states[name], condition=condition, told=told, place=place)


def _seen(file: str | None, host: str) -> tuple[HostCondition, tuple[Diagnostic, ...]]:
    if file is None:
        return HostCondition(), ()
    return seen_in(read_file(file, MAX_BYTES, SnapshotUnreadable.finding), host)
