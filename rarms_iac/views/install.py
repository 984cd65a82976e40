"""The output of `rarms install`: a line for each host."""

from typing import TYPE_CHECKING

from rarms_iac.app.install import HostInstallation, Installation
from rarms_iac.model.commands import DOCTOR, START_AT_BOOT, prose
from rarms_iac.views.console import paragraph, stack
from rarms_iac.views.table import Column, Table

if TYPE_CHECKING:
    from rich.console import RenderableType


HOSTS = (Column("host"), Column("rarms", wraps=True), Column("machine", wraps=True), Column("sent", right=True))


def installation_text(result: Installation) -> "RenderableType":
    """Show a line for each host, and the next command."""
    rows = [(host.host, _became(host), f"Python {host.python}, {host.machine}", _sent(host)) for host in result.hosts]
    finished = [
        paragraph(f"{host.host}: rarms {run.version} finished its run of plan {run.plan}.")
        for host in result.hosts
        for run in host.finished
    ]
    without_boot = [host.host for host in result.hosts if host.changed and host.version and not host.boot]
    boot = f"{', '.join(without_boot)}: neither systemd nor cron is there. Run this at each start of the machine: "
    return stack(
        Table(HOSTS, rows),
        *finished,
        paragraph(prose(boot, START_AT_BOOT, ".")) if without_boot else None,
        paragraph(prose("Next: ", DOCTOR)) if any(host.version for host in result.hosts) else None,
    )


def _became(host: HostInstallation) -> str:
    if not host.version:
        return f"rarms {host.before} removed" if host.before else "rarms is not installed"
    if not host.changed:
        return f"rarms {host.version} is already installed"
    was = f", was {host.before}" if host.before and host.before != host.version else ""
    return f"rarms {host.version} installed{was}"


def _sent(host: HostInstallation) -> str:
    return f"{host.sent_bytes / 1e6:.0f} MB" if host.sent_bytes else ""
