"""Checks of hosts: platform, how they are reached, paths, what they keep for themselves; and of secrets.

The manifest lies in git, so it holds references to secrets only.
"""

import re
from collections.abc import Iterator

from rarms_iac.manifest.checks.violation import Violation, allowed_hosts, check, component_check, host_check, violation
from rarms_iac.model.host import Host, HypervHost, ProviderKind, WinRmConnect
from rarms_iac.model.mmcss import OFF, is_taken_as_is, taken_for
from rarms_iac.model.quantities import in_processors
from rarms_iac.model.system import Component, RunsOn, System
from rarms_iac.texts.findings import (
    GENERATION,
    NO_EFFECT,
    NO_RESPONSIVENESS,
    OVER_HOST,
    UNKNOWN_KEY,
    WRONG_VALUE,
    Finding,
)
from rarms_iac.texts.messages import quoted
from rarms_iac.texts.quantities import show_processors, write_bytes

TOO_LITTLE = Finding.warning("RARMS058", "Too little memory or processor time for components")

_ABSOLUTE = re.compile(r"[A-Za-z]:[\\/]|[\\/]{2}[^\\/]")
_NOT_IN_A_PATH = re.compile(r'[<>"|?*\x00-\x1f]')
_WILDCARD = re.compile(r"[\[\]`]")  # PowerShell reads them as a pattern where a cmdlet takes -Path

_REFERENCE = re.compile(r"[A-Za-z0-9][A-Za-z0-9._/-]{0,127}")
_KEY = re.compile(r"(?=.*[a-z])(?=.*[A-Z])(?=.*[0-9])[A-Za-z0-9_-]{16,}")
_SECRET = re.compile(r"(?i)(password|passwd|passphrase|secret|api_?key|access_?key|private_?key|(^|_)token$|(^|_)pw$)")


@check(TOO_LITTLE)
def nothing_kept_for_host(system: System) -> Iterator[Violation]:
    """Find hosts that keep no processor time, or too little memory, for components that may run on them."""
    on_host = [component for component in system.components.values() if component.runs_on is RunsOn.HOST]
    for host in system.hosts.values():
        here = [component for component in on_host if host in allowed_hosts(system, component)]
        memory = sum(component.memory for component in here)
        lacks = []
        if here and in_processors(host.keep_for_host.processor, host.logical_processors) == 0:
            lacks.append("no processor time")
        kept_memory = host.keep_for_host.memory
        if here and kept_memory < memory:
            lacks.append(f"{write_bytes(kept_memory)} of the {write_bytes(memory)} that they need")
        if lacks:
            yield violation(
                ("hosts", host.name, "keep_for_host"),
                (
                    '{components} may run on "{host}" itself, but `keep_for_host` keeps {_lacks}. Partitions may use '
                    "all other capacity."
                ),
                (
                    "Keep enough for the components: `keep_for_host: { processor: ..., memory: "
                    f"{write_bytes(memory)} }}`."
                ),
                components=tuple(component.name for component in here),
                keeps_memory_bytes=host.keep_for_host.memory,
                needs_memory_bytes=memory,
                _lacks=" and ".join(lacks),
            )


@host_check(OVER_HOST)
def keeps_more_than_it_has(host: Host) -> Iterator[Violation]:
    """Find more processors or memory in `keep_for_host` than the host has."""
    withheld = host.keep_for_host
    processors = in_processors(withheld.processor, host.logical_processors)
    if processors > host.logical_processors:
        yield _withheld(host, "processor", show_processors(processors), show_processors(host.logical_processors))
    if withheld.memory > host.memory:
        yield _withheld(host, "memory", write_bytes(withheld.memory), write_bytes(host.memory))


def _withheld(host: Host, field: str, amount: str, available: str) -> Violation:
    return violation(
        ("hosts", host.name, "keep_for_host", field),
        '"{host}" has {has} and keeps {keeps}: nothing is left for partitions.',
        "Keep less for the host, or correct the host's size.",
        keeps=amount,
        has=available,
    )


@host_check(NO_EFFECT)
def connect_to_simulated(host: Host) -> Iterator[Violation]:
    """Find `connect` on a simulated host."""
    if host.provider is ProviderKind.SIMULATED and host.connect is not None:
        yield violation(
            ("hosts", host.name, "connect"),
            '"{host}" is simulated. It is a file on this machine, so `connect` has no effect.',
            "Remove `connect`, or write the provider of the real host.",
            at_key=True,
            provider=host.provider.value,
        )


@host_check(UNKNOWN_KEY)
def not_by_winrm(host: Host) -> Iterator[Violation]:
    """Find `winrm` to a host without Windows, or with only one of user and password."""
    if not isinstance(host.connect, WinRmConnect):
        return
    path = ("hosts", host.name, "connect")
    if host.provider is ProviderKind.LINUX:
        yield violation(
            (*path, "winrm"),
            '"{host}" is a Linux host, but WinRM works with Windows only.',
            "Write `connect: {ssh: user@host}`.",
            at_key=True,
            provider=host.provider.value,
            host=host.name,
        )
    if (host.connect.user is None) is not (host.connect.password is None):
        missing = "user" if host.connect.user is None else "password"
        yield violation(
            path,
            '`connect` of "{host}" has no `{missing}`: WinRM needs both user and password, or neither.',
            f"Write `{missing}`, or leave out both to use the Kerberos ticket.",
            at_key=True,
            missing=missing,
            host=host.name,
        )


@check(Finding.error("RARMS085", "Hosts of one platform differ"))
def platform_of_different_hosts(system: System) -> Iterator[Violation]:
    """Find hosts whose provider or LPs differ from the first host of their platform."""
    first: dict[str, Host] = {}
    for host in system.hosts.values():
        other = first.setdefault(host.platform, host)
        difference = _difference(other, host)
        if difference:
            yield violation(
                ("hosts", host.name, "platform"),
                '"{host}" and "{other}" have the platform "{platform}" and share measurements, but '
                "{_difference}. A measurement on one host is not valid on the other.",
                "Give the hosts different platforms.",
                related=((("hosts", other.name), True, "the other host"),),
                other=other.name,
                platform=host.platform,
                provider=host.provider.value,
                other_provider=other.provider.value,
                host_lp=host.logical_processors,
                other_lp=other.logical_processors,
                _difference=difference,
            )


def _difference(host: Host, other: Host) -> str:
    if host.provider is not other.provider:
        return f"their providers are {host.provider.value} and {other.provider.value}"
    if host.logical_processors != other.logical_processors:
        return f"they have {host.logical_processors} and {other.logical_processors} logical processors"
    return ""


@check(WRONG_VALUE)
def path_on_windows(system: System) -> Iterator[Violation]:
    """Find paths that are relative, not valid on Windows, or a pattern to a cmdlet."""
    hosts = {name: host.settings for name, host in system.hosts.items() if isinstance(host.settings, HypervHost)}
    for name, host in hosts.items():
        yield from _path_violations("hosts", name, {"image": host.image, "vm_path": host.vm_path})
    if hosts:
        for name, partition in system.partitions.items():
            paths = {"image": partition.hyperv.image, "vm_path": partition.hyperv.vm_path}
            yield from _path_violations("partitions", name, paths)


@check(GENERATION)
def secure_boot_of_generation_1(system: System) -> Iterator[Violation]:
    """Find secure boot for machines of generation 1, which have a BIOS."""
    hosts = {name: host.settings for name, host in system.hosts.items() if isinstance(host.settings, HypervHost)}
    found = [("hosts", name) for name, host in hosts.items() if host.secure_boot and host.generation == 1]
    usual = {host.generation for host in hosts.values()}
    for name, partition in system.partitions.items():
        generations = usual if partition.hyperv.generation is None else {partition.hyperv.generation}
        if partition.hyperv.secure_boot and generations == {1}:
            found.append(("partitions", name))
    for section, name in found:
        yield violation(
            (section, name, "hyperv", "secure_boot"),
            "A machine of generation 1 has no secure boot.",
            "Remove `secure_boot`, or use `generation: 2`.",
            generation=1,
        )


def _path_violations(section: str, name: str, paths: dict[str, str | None]) -> Iterator[Violation]:
    for key, path in paths.items():
        if path is not None and (problem := _path_problem(path)):
            yield violation(
                (section, name, "hyperv", key),
                '"{file}" {_problem}.',
                r"Write a full path of the host, for example D:\machines or \\server\share\machines.",
                key=key,
                file=path,
                _problem=problem,
            )


def _path_problem(path: str) -> str:
    if not _ABSOLUTE.match(path):
        return "does not begin with a drive or a share, so it depends on the start folder of a script"
    if found := _NOT_IN_A_PATH.search(path):
        return f"contains {quoted(found.group())}, which Windows does not allow in a path"
    if found := _WILDCARD.search(path):
        return f"contains {quoted(found.group())}, which PowerShell reads as a pattern"
    return ""


@check(NO_RESPONSIVENESS)
def responsiveness_not_as_is(system: System) -> Iterator[Violation]:
    """Find values that Windows rounds or takes for the end of MMCSS, and hosts without MMCSS."""
    for host in system.hosts.values():
        percent = host.system_responsiveness
        if percent is None:
            continue
        advice = "Write 10, 20, ... or 90. The default of Windows is 20."
        if host.provider is ProviderKind.LINUX:
            template = '"{host}" is a Linux host. MMCSS exists on Windows only.'
            advice = "Remove `system_responsiveness`."
        elif is_taken_as_is(percent):
            continue
        elif percent == OFF:
            template = "{percent} switches MMCSS off: no task class would have an effect."
        else:
            reason = "rounds down to tens" if 10 <= percent <= OFF else "uses this default below 10 and above 100"
            template = f"Windows would use {{taken_percent}} instead of {{percent}}: it {reason}."
        yield violation(
            ("hosts", host.name, "system_responsiveness"),
            template,
            advice,
            percent=percent,
            taken_percent=taken_for(percent),
            provider=host.provider.value,
        )


@check(Finding.error("RARMS090", "The manifest contains a secret"))
def secret_in_clear(system: System) -> Iterator[Violation]:
    """Find credentials that do not look like the name of one."""
    named = [
        (("partitions", name, "guest"), name, request.guest.credential) for name, request in system.partitions.items()
    ]
    for name, host in system.hosts.items():
        if isinstance(host.settings, HypervHost):
            named.append((("hosts", name, "hyperv"), name, host.settings.credential))
    for path, name, credential in named:
        if credential is not None and not is_reference(credential):
            yield violation(
                (*path, "credential"),
                'The credential of "{name}" looks like the secret itself. The manifest is in git, where others can '
                "read it and old versions remain.",
                (
                    "Write the name of the stored credential, for example `robot/guest`. A name has only letters, "
                    "digits and . _ / -. Change the secret if it was committed."
                ),
                key="credential",
                name=name,
            )


def is_reference(text: str) -> bool:
    """Return whether the text may be a credential's name: no character of passwords, not as mixed as a key."""
    return _REFERENCE.fullmatch(text) is not None and _KEY.fullmatch(text) is None


@component_check(Finding.warning("RARMS091", "The manifest contains a variable that looks like a secret"))
def secret_in_environment(component: Component) -> Iterator[Violation]:
    """Find variables with a secret's name whose value stands in the manifest."""
    for path, name, value in component.run.own_variables if component.run is not None else ():
        if isinstance(value, str) and value and _SECRET.search(name):
            yield violation(
                ("components", component.name, "run", *path),
                'The manifest contains the value of {variable} for "{component}". The manifest is in git, where '
                "others can read it.",
                f"Write `{name}: {{ from_env: {name} }}`. Change the secret if it was committed.",
                variable=name,
            )
