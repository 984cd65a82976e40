"""A cluster may move a machine, and keeps a copy of its settings (FACTS 5)."""

from collections.abc import Iterator

from rarms_iac.apply.doctor.examination import Examination, address_of, called
from rarms_iac.model.diagnostics import Diagnostic, Finding, Severity

FINDING = Finding(code="RARMS244", severity=Severity.WARNING, summary="A machine belongs to a cluster")


def check(host: Examination) -> Iterator[Diagnostic]:
    """Tells of clustered machines."""
    for machine, odd in host.machines():
        if odd.clustered:
            yield FINDING.at(
                host.place,
                f"{called(machine)} on {host.state.facts.name} belongs to a failover cluster: it may move to another "
                "host, or come from one, and takes its reserve along.",
                "Keep robots' partitions out of the cluster. After a change of memory or devices run "
                "`Update-ClusterVirtualMachineConfiguration`, and plan again after a move.",
                address=address_of(machine),
            )
