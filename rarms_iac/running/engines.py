"""Makes the words that start and end a container (docker, podman) or a transient service (systemd).

In: a `Container` or `Service` of the manifest and its partition's group. Out: words, and an `Ending`. Begin at
`container_words` and `service_words`. podman and systemd are tested; docker gets the same options, and was never tried.

The variables of a container or service are in a file: its engine's own program, which is root, has those of rarms.
"""

import math
import os
import re
import secrets
import shutil
import tempfile
from collections.abc import Iterator, Mapping
from dataclasses import dataclass, replace
from pathlib import Path
from typing import assert_never

from rarms_iac.model.run import (
    Attached,
    AttachedContainer,
    AttachedService,
    Container,
    Process,
    ServiceProperties,
    Stop,
)
from rarms_iac.running.orders import CannotStart, Ending, VariablesFile

SYSTEMD = Path("/run/systemd/system")
"""It is there where systemd is process 1 (sd_booted(3))."""

_NOT_IN_A_NAME = re.compile(r"[^a-zA-Z0-9_.-]")
_QUOTED_BY_SYSTEMD = re.compile(r'["\\`$]')


@dataclass(frozen=True, slots=True, kw_only=True)
class EngineStart:
    """The words that start a container or service, with its end and its variables."""

    words: tuple[str, ...]
    ending: Ending
    variables: VariablesFile


def with_whole_path(container: Container, base: Path) -> Container:
    """Return a container whose image is a folder (`--rootfs`) with the folder's whole path, which podman needs."""
    is_folder = "--rootfs" in container.options
    return replace(container, image=str((base / container.image).resolve())) if is_folder else container


def container_words(name: str, process: Process, stop: Stop, parent: str, variables: Mapping[str, str]) -> EngineStart:
    """Return the words that run a container in the foreground.

    Args:
        name: of the component, from which the container's is made.
        parent: the control group in which the container's own is made; empty: the engine chooses.
        variables: those of the environment that it gets.

    Raises:
        CannotStart: a value has a line break, which no engine reads from a file.
    """
    container = process.container
    assert container is not None
    for variable, value in variables.items():
        if "\n" in value or "\r" in value:
            advice = "Give it a mounted file instead: `--volume=/opt/robot/key.pem:/key.pem:ro`."
            raise CannotStart(name, f"the variable {variable} of its container has a line break", advice)
    unit = _unit(name)
    lines = (f"{variable}={value}\n" for variable, value in variables.items())
    file = VariablesFile(path=_file_of(unit), values=variables, text="".join(lines))
    words = (
        container.engine,
        "run",
        "--rm",
        f"--name={unit}",
        *((f"--cgroup-parent={parent}",) if parent else ()),
        f"--stop-signal=SIG{stop.signal}",
        f"--stop-timeout={_whole_seconds(stop)}",
        *((f"--user={process.user}",) if process.user else ()),
        *(f"--group-add={group}" for group in process.groups),
        f"--env-file={file.path}",
        *container.options,
        container.image,
        *container.command,
    )
    at_once = ("--time=0", "--ignore") if container.engine == "podman" else ()
    ending = Ending(
        unit=unit,
        stop=(container.engine, "stop", "-t", str(_whole_seconds(stop)), unit),  # docker 28 deprecates --time
        remove=((container.engine, "rm", "--force", *at_once, unit),),
        is_below=container.engine == "podman",
    )
    return EngineStart(words=words, ending=ending, variables=file)


def service_words(
    name: str, process: Process, stop: Stop, parent: str, variables: Mapping[str, str], folder: Path
) -> EngineStart:
    """Return the words that run a transient service of systemd and pass on its output.

    Args:
        name: of the component, from which the unit's is made.
        parent: the slice of the partition; empty: that of all services.
        variables: those of the environment that it gets.
        folder: its folder, unless the properties name one.

    Raises:
        CannotStart: systemd does not run here, or the partition is not one of its slices.
    """
    service = process.service
    assert service is not None
    if not SYSTEMD.is_dir():
        raise CannotStart(name, "it is a service, but systemd does not run here", "Write a `command` instead.")
    if parent and not parent.endswith(".slice"):
        advice = "Remove `linux: { control_groups: v1 }` from the host, or write a `command` instead."
        raise CannotStart(name, f"it is a service, but its partition {parent} is not a slice of systemd", advice)
    unit = f"{_unit(name)}.service"
    lines = (f'{variable}="{_quoted(value)}"\n' for variable, value in variables.items())
    file = VariablesFile(path=_file_of(unit), values=variables, text="".join(lines))
    words = (
        "systemd-run",
        "--quiet",
        "--wait",
        "--pipe",
        "--collect",
        "--service-type=exec",
        f"--unit={unit}",
        *((f"--slice={parent}",) if parent else ()),
        *(f"--property={each}" for each in _properties(process, service.properties, stop, folder)),
        f"--property=EnvironmentFile={file.path}",
        "--",
        *service.exec,
    )
    ending = Ending(
        unit=unit,
        stop=("systemctl", "stop", unit),
        # Without the first one, systemd starts a service with `Restart` again.
        remove=(("systemctl", "stop", "--no-block", unit), ("systemctl", "kill", "--signal=KILL", unit)),
    )
    return EngineStart(words=words, ending=ending, variables=file)


def log_words(name: str, attached: Attached) -> tuple[str, ...]:
    """Return the words that print each new line of a running service or container.

    Args:
        name: of the component, for what is raised.

    Raises:
        CannotStart: no engine is installed, or two are and the manifest chooses none.
    """
    match attached:
        case AttachedService(service=service):
            return ("journalctl", "--follow", "--lines=0", "--output=cat", f"--unit={unit_of(service)}")
        case AttachedContainer(container=container):
            return (engine_of(name, attached), "logs", "--follow", "--since=0s", container)
        case never:
            assert_never(never)


def unit_of(service: str) -> str:
    """Return the name of a service's unit."""
    return service if service.endswith(".service") else f"{service}.service"


def engine_of(name: str, attached: AttachedContainer) -> str:
    """Return the engine of a running container.

    Raises:
        CannotStart: as of `log_words`.
    """
    installed = [engine for engine in ("docker", "podman") if shutil.which(engine)]
    if attached.engine is not None or len(installed) == 1:
        return attached.engine or installed[0]
    if installed:
        message = f"docker and podman are installed, and both may have a container {attached.container}"
        raise CannotStart(name, message, "Write `engine: docker` or `engine: podman`.")
    raise CannotStart(name, "it is a container, but docker and podman are not installed", "Install its engine.")


def _properties(process: Process, own: ServiceProperties, stop: Stop, folder: Path) -> Iterator[str]:
    yield f"KillSignal=SIG{stop.signal}"
    yield f"TimeoutStopSec={float(stop.grace):.0f}ms"
    yield f"WorkingDirectory={own.working_directory or folder}"
    if process.user:
        yield f"User={process.user}"
    if groups := (*process.groups, *own.supplementary_groups):
        yield f"SupplementaryGroups={' '.join(groups)}"
    yield from (f"Environment={variable}" for variable in own.environment)
    if own.limit_memlock:
        yield f"LimitMEMLOCK={own.limit_memlock}"
    if own.restart != "no":
        yield f"Restart={own.restart}"
    if own.nice is not None:
        yield f"Nice={own.nice}"
    if own.scheduling_policy != "other":
        yield f"CPUSchedulingPolicy={own.scheduling_policy}"
    if own.scheduling_priority is not None:
        yield f"CPUSchedulingPriority={own.scheduling_priority}"


def _unit(component: str) -> str:
    """Return a name that no other program's container or service has."""
    return f"rarms-{_NOT_IN_A_NAME.sub('-', component)}-{secrets.token_hex(4)}"


def _file_of(unit: str) -> Path:
    """Return the file of variables, where systemd sees it, too: a service may have a `/tmp` of its own."""
    return (Path("/run") if os.geteuid() == 0 else Path(tempfile.gettempdir())) / f"{unit}.env"


def _quoted(value: str) -> str:
    """Return a value as it is between double quotes in a file of systemd (systemd.exec(5), EnvironmentFile)."""
    return _QUOTED_BY_SYSTEMD.sub(r"\\\g<0>", value)


def _whole_seconds(stop: Stop) -> int:
    return math.ceil(float(stop.grace) / 1000)
