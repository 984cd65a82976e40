"""The chosen hosts as the doctor is shown them: their States, and what else was seen there."""

from collections.abc import Iterator

from rarms_iac.apply.doctor.examination import Examination
from rarms_iac.cli.hosts import Hosts, observed
from rarms_iac.cli.wiring import seen_by_script
from rarms_iac.model.condition import HostCondition


def examinations(hosts: Hosts) -> Iterator[Examination]:
    """Every chosen host, by name.

    Raises:
        Halted: one of them cannot be reached or read.
    """
    states = observed(hosts)
    for name in hosts.chosen:
        file = hosts.snapshots.hosts.get(name)
        seen = seen_by_script(file.data, name) if file else None
        yield Examination(
            state=states[name],
            condition=seen.condition if seen else HostCondition(),
            told=seen.findings if seen else (),
            place=hosts.opened.loaded.places.key("hosts", name),
        )
