"""The chosen hosts as the doctor is shown them: their States, and what else was seen there."""

from collections.abc import Iterator

from rarms_iac.app.hosts import Hosts, host_errors, observe_host
from rarms_iac.app.wiring import read_script_output
from rarms_iac.apply.doctor.examination import Examination
from rarms_iac.model.condition import HostCondition
from rarms_iac.providers.interface import ExaminableHost, HostLook


def examinations(hosts: Hosts) -> Iterator[Examination]:
    """Every chosen host, by name, each looked at once.

    Raises:
        UseCaseError: one of them cannot be reached or read.
    """
    for name in hosts.chosen:
        looked = _look(hosts, name)
        yield Examination(
            state=looked.state,
            condition=looked.condition,
            provider_findings=looked.findings,
            place=hosts.manifest.places.key("hosts", name),
        )


def _look(hosts: Hosts, name: str) -> HostLook:
    file = hosts.snapshots.hosts.get(name)
    if file is not None:
        seen = read_script_output(file.data, name)
        condition = seen.condition if seen else HostCondition()
        return HostLook(state=file.state, condition=condition, findings=file.findings)
    host = hosts.open(name)
    if isinstance(host, ExaminableHost):
        with host_errors():
            return host.examined()
    return HostLook(state=observe_host(host), condition=HostCondition(), findings=())
