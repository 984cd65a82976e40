"""Disk images and folders of machines have paths that mean one place on a Windows host."""

import re
from collections.abc import Iterator

from rarms_iac.model.diagnostics import Diagnostic, Finding, Places, Severity
from rarms_iac.model.system import HypervHost, System

FINDING = Finding(code="RARMS099", severity=Severity.ERROR, summary="A path that a Windows host cannot take")

_ABSOLUTE = re.compile(r"[A-Za-z]:[\\/]|[\\/]{2}[^\\/]")
_NOWHERE = re.compile(r'[<>"|?*\x00-\x1f]')
_PATTERN = re.compile(r"[\[\]`]")  # PowerShell reads them as a pattern where a cmdlet takes -Path


def check(system: System, places: Places) -> Iterator[Diagnostic]:
    """Tells of paths that are not absolute, that no Windows has, and that a cmdlet would read as a pattern."""
    hosts = {name: host.settings for name, host in system.hosts.items() if isinstance(host.settings, HypervHost)}
    for name, host in hosts.items():
        yield from _told(("hosts", name), host.image, host.vm_path, places)
    if hosts:
        for name, partition in system.partitions.items():
            yield from _told(("partitions", name), partition.hyperv.image, partition.hyperv.vm_path, places)


def _told(at: tuple[str, str], image: str | None, folder: str | None, places: Places) -> Iterator[Diagnostic]:
    for key, path in (("image", image), ("vm_path", folder)):
        says = _wrong(path) if path is not None else ""
        if says:
            yield FINDING.at(
                places.value(*at, "hyperv", key),
                f'"{path}" {says}.',
                r"Write a whole path of the host, as D:\machines or \\server\share\machines.",
                address=f"{at[0].removesuffix('s')}/{at[1]}",
            )


def _wrong(path: str) -> str:
    if not _ABSOLUTE.match(path):
        return "does not begin with a drive or a share: it would depend on the folder a script is started in"
    if found := _NOWHERE.search(path):
        return f"has {found.group()!r}, which no path of Windows has"
    if found := _PATTERN.search(path):
        return f"has {found.group()!r}, which PowerShell reads as a pattern"
    return ""
