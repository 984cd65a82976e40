"""What is started, and where: orders for the supervisor, the place of a component's processes, and what goes wrong."""

import os
from collections.abc import Mapping
from dataclasses import asdict, dataclass, field
from pathlib import Path
from typing import Any

from rarms_iac.model.run import OutputStream, Stop
from rarms_iac.running.thread_priorities import ThreadRule


class RunningError(Exception):
    """Something about a component's processes that its samples cannot tell."""


class CannotStart(RunningError):
    """The component cannot be started as its `run` in the manifest asks."""

    def __init__(self, component: str, message: str, advice: str = "") -> None:
        super().__init__(f"{component}: {message}")
        self.component = component
        self.message = message
        self.advice = advice  # empty: what helps where a program is not found


class SupervisorLost(RunningError):
    """The process between rarms and the component is gone: it was killed, and the component was ended with it."""

    def __init__(self, component: str, message: str) -> None:
        super().__init__(f"{component}: {message}")
        self.component = component
        self.message = message


@dataclass(frozen=True, slots=True, kw_only=True)
class ProcessPlace:
    """The place of a component's processes; empty: with everything else on the machine.

    `words` stand before the component's own and bring it into its partition (`systemd-run --scope`); `priority` are
    those that give it its deadline or task class (`chrt`, `taskset`). `join` are files that take the process' id before
    the component begins (`cgroup.procs`), so that nothing of it ever runs outside. `parent` is the partition's group as
    container engines and systemd name it. `environment` is for `rcss`, and `task` is the class that the caller's thread
    joins, where only the thread itself can (Windows). `groups` are the folders of control groups in which all of its
    processes must be, and that count their processor time; `memory_events` is the file in which the kernel counts the
    processes that it killed for the group's memory. `threads` are the rules by which the supervisor gives threads in
    these groups their priority.
    """

    words: tuple[str, ...] = ()
    priority: tuple[str, ...] = ()
    join: tuple[Path, ...] = ()
    parent: str = ""
    environment: Mapping[str, str] = field(default_factory=dict)
    task: str = ""
    groups: tuple[Path, ...] = ()
    memory_events: Path | None = None
    threads: tuple[ThreadRule, ...] = ()


@dataclass(frozen=True, slots=True, kw_only=True)
class Ending:
    """How a process ends that runs elsewhere than below the one that was started, such as a container.

    In all words of a process the supervisor replaces `unit` by a name of its own for each start.
    """

    unit: str  # the name of the container or service
    stop: tuple[str, ...]  # asks it to end, and waits until it did or its grace is over
    remove: tuple[tuple[str, ...], ...]  # commands that end it at once; it may be gone
    is_below: bool = False  # its processes are below the supervisor, as those of podman are


@dataclass(frozen=True, slots=True, kw_only=True)
class VariablesFile:
    """A file with the variables of a container or service, which no variable of its engine's own program may be."""

    path: Path  # with the name of the container or service; it is there as long as that runs
    values: Mapping[str, str]
    text: str  # the values as the engine reads them


@dataclass(frozen=True, slots=True, kw_only=True)
class ProcessOrder:
    """A process as the supervisor starts it."""

    name: str  # of several; empty: the only one
    words: tuple[str, ...]  # the program's whole path first
    folder: Path
    environment: Mapping[str, str]
    join: tuple[Path, ...] = ()
    stream: OutputStream | None = "stdout"  # whose lines are read; None: those of another process are
    ending: Ending | None = None  # None: it is ended by signals
    variables: VariablesFile | None = None


@dataclass(frozen=True, slots=True, kw_only=True)
class StartOrder:
    """A component or load: processes that start in this order, all or none, and end together."""

    name: str
    processes: tuple[ProcessOrder, ...]
    stop: Stop
    file: Path | None = None  # from which lines are read instead of the stream
    socket: Path | None = None
    threads: tuple[ThreadRule, ...] = ()
    groups: tuple[Path, ...] = ()  # in which threads are looked for; empty: all that the supervisor started
    keeps_priority: bool = False  # a real-time priority that rarms has: it is a part of rarms


def order_as_json(order: StartOrder) -> dict[str, Any]:
    """Return an order as the supervisor's program reads it."""
    processes = [
        {
            "name": process.name,
            "words": process.words,
            "folder": str(process.folder),
            "environment": dict(process.environment),
            "join": [str(file) for file in process.join],
            "stream": process.stream,
            "ending": None if process.ending is None else asdict(process.ending),
            "variables": None if process.variables is None else _variables_as_json(process.variables),
        }
        for process in order.processes
    ]
    return {
        "processes": processes,
        "signal": order.stop.signal,
        "grace_ms": float(order.stop.grace),
        "threads": order.threads,
        "groups": [str(group) for group in order.groups],
        "keeps_priority": order.keeps_priority,
    }


def _variables_as_json(variables: VariablesFile) -> dict[str, str]:
    return {"path": str(variables.path), "text": variables.text}


@dataclass(frozen=True, slots=True, kw_only=True)
class StartContext:
    """The surroundings of a component's start: the manifest's folder, rarms' own environment, and the partition."""

    base: Path
    environment: Mapping[str, str] = field(default_factory=lambda: dict(os.environ))
    inside: ProcessPlace = field(default_factory=ProcessPlace)
