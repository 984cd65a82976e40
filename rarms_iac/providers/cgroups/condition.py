"""Findings about the condition of a Linux host, for `rarms doctor` and plans."""

from collections.abc import Iterator, Sequence

from rarms_iac.model.commands import APPLY, START_AT_BOOT, prose
from rarms_iac.model.diagnostics import Diagnostic, Finding
from rarms_iac.model.host import Host
from rarms_iac.model.wording import counted
from rarms_iac.providers.cgroups.group_settings import slice_limit

ORPHANS = Finding.note("RARMS168", "Processes run in a partition that rarms did not start")
OFF_WITHOUT_STOP = Finding.warning("RARMS316", "Partitions are off that were not stopped with rarms")
NOTHING_WITHHELD = Finding.note("RARMS317", "A Linux host keeps no processor time for itself")


def orphan_findings(partition: str, processes: Sequence[tuple[int, str]]) -> Iterator[Diagnostic]:
    """Find processes, by id and name, that run in a partition and end with no component."""
    if processes:
        names = ", ".join(f"{process} ({name})" for process, name in processes)
        yield ORPHANS.at(
            None,
            "In {partition} run processes that no rarms started or ends: {_names}.",
            "End them, where a component left them behind: they use the partition's processor time.",
            address=f"partition/{partition}",
            partition=partition,
            processes=tuple(str(process) for process, _ in processes),
            _names=names,
        )


def off_without_stop(host: Host, partitions: Sequence[str]) -> Iterator[Diagnostic]:
    """Find partitions that are off, and that no run stopped."""
    if partitions:
        line = ' does that at each start, as a line of the machine (docs/linux.md, "After the machine starts").'
        yield OFF_WITHOUT_STOP.of_host(
            host.name,
            "{_counted} of {host} ran until the machine stopped, or until the control group was removed: "
            "{partitions:all}.",
            prose(APPLY, " starts what is off. ", START_AT_BOOT, line),
            partitions=tuple(partitions),
            _counted=counted(len(partitions), "partition"),
        )


def nothing_withheld(host: Host, processors: int) -> Iterator[Diagnostic]:
    """Find that partitions may use all of the machine's logical processors (`processors`)."""
    if slice_limit(host, processors) is None:
        yield NOTHING_WITHHELD.of_host(
            host.name,
            "{host} keeps no processor time for what runs outside its partitions. While they use all of "
            "it, ssh, rarms and the kernel's own threads get about 1 % of a processor each.",
            "Write `keep_for_host: { processor: 5 % }`: partitions never get that part.",
        )
