"""A measurement as a script: the test partitions that it makes, and what it runs inside guests meanwhile.

One script an experiment. It holds the host, makes the test partitions, receives the reserves setting after setting
(docs/hyperv.md), passes on what guests say, and removes what it made, however it ends. Without partitions and work it
only removes what a killed one left.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from math import floor

from rarms_iac.model.capacity import capacity_of
from rarms_iac.model.host import Host, HypervHost
from rarms_iac.model.setting import PartitionShape
from rarms_iac.model.state import HostFacts
from rarms_iac.powershell.literals import Scalar, literal
from rarms_iac.powershell.pieces import call
from rarms_iac.powershell.templates import MEASURING_ENTRY, ScriptForm, fact_lines, fill, module_text
from rarms_iac.storage.json_text import canonical
from rarms_iac.texts.messages import remark

UNPLANNED = "0" * 12
"""Stands for a plan's id in pending names, marks and names of disks: test partitions belong to no plan."""


@dataclass(frozen=True, slots=True, kw_only=True)
class GuestWork:
    """A program that runs inside the guest of a partition, and how it is heard."""

    partition: str
    credential: str  # under which name the host keeps it
    name: str  # a component's; empty: a load's
    kind: str  # lines, runs, load, or calibrated: a load that writes a line when it has counted what it may do
    words: tuple[str, ...]
    environment: Mapping[str, str] | None = None
    files: Mapping[str, str] | None = None  # by path below the work folder in the guest: base64
    period_ticks: int = 0  # 100 ns; 0: the next job starts when the last one ended
    timeout_ms: int = 0
    instances: int = 1


def render_measuring(
    host: Host, facts: HostFacts, application: str, shapes: Sequence[PartitionShape], works: Sequence[GuestWork]
) -> bytes:
    """Make the script.

    Args:
        shapes: test partitions, in the order in which their reserves are sent.
        works: programs inside guests; none: the script only removes test partitions.

    Returns:
        ASCII text with CRLF.

    Raises:
        NoLiteral: a value cannot be written into a script.
    """
    settings = host.hyperv
    lines = [
        *(line for each in shapes for line in ("", f"    # === test partition {each.name}", _machine(each, settings))),
        *(line for work in works for line in ("", f"    # === in {work.partition}: {_title(work)}", _work(work))),
    ]
    name = script_name(host)
    removal = "Remove the test partitions that a killed measurement left, with their disks."
    values = {
        "requirements": ("-Modules Hyper-V", "-RunAsAdministrator"),
        "name": name,
        "synopsis": remark(f"rarms measure script: application {application}, on {host.name}."),
        "description": (
            f"Computer {remark(facts.computer_name)}.",
            *(f"Makes {shape.name} from {remark(settings.image or '')}." for shape in shapes),
            *(f"Runs {_title(work)} inside {work.partition}." for work in works),
            "At the end, also after an error, it removes the test partitions and their disks." if works else removal,
        ),
        "usage": "Shows the planned machines. Without -WhatIf, the script measures the settings that rarms sends."
        if works
        else removal,
        "notes": (),
        "facts": fact_lines(_run(host, facts, application)),
        "entry": MEASURING_ENTRY,
        "impact": "Medium",
        "plan": lines,
        "unasked": ("A preview ends before it calls one of these.",),
        "module": module_text(ScriptForm.SINGLE, MEASURING_ENTRY),
    }
    return fill("script.ps1.j2", values)


def script_name(host: Host) -> str:
    """Name the script of a host: `onboard.measure.ps1`."""
    return f"{host.name}.measure.ps1"


def _title(work: GuestWork) -> str:
    return remark(work.name or f"the load {work.words[0]}")


def _run(host: Host, facts: HostFacts, application: str) -> dict[str, str]:
    capacity = capacity_of(host, facts)
    values: dict[str, Scalar] = {
        "Run": "measure",
        "Purpose": "",
        "Plan": UNPLANNED,
        "Application": application,
        "Robot": "",
        "Serial": 0,
        "Undo": "",
        "UndoDigest": "",
        "Guest": "",
        "Identity": facts.id,
        "Computer": facts.computer_name,
        "LogicalProcessors": facts.logical_processors,
        "Cores": capacity.cores,
        "ThreadsPerCore": capacity.sharing.threads,
        "Percent": max(0, floor(100 * capacity.processors)),
        "Memory": capacity.memory,
        "AcceptScheduler": False,
    }
    return {name: literal(value) for name, value in values.items()}


def _machine(shape: PartitionShape, settings: HypervHost) -> str:
    image = settings.image or ""
    return "    " + call(
        "Add-TestPartition",
        Name=literal(shape.name),
        Processors=literal(shape.processors),
        Memory=literal(shape.memory),
        Limit=literal(shape.limit),
        Weight=literal(shape.weight),
        Generation=literal(settings.generation),
        Image=literal(image),
        Type=literal("vhd" if image.lower().endswith(".vhd") else "vhdx"),
        Folder=literal(settings.vm_path or ""),
        SecureBoot=literal((settings.secure_boot or "") if settings.generation == 2 else ""),
    )


def _work(work: GuestWork) -> str:
    return "    " + call(
        "Add-GuestWork",
        Partition=literal(work.partition),
        Logon=literal(work.credential),
        Name=literal(work.name),
        Kind=literal(work.kind),
        Program=literal(work.words[0]),
        Arguments=literal(command_line(work.words[1:])),
        Environment=literal(canonical(dict(work.environment or {}))),
        Files=literal(canonical(dict(work.files or {}))),
        PeriodTicks=literal(work.period_ticks),
        TimeoutMs=literal(work.timeout_ms),
        Instances=literal(work.instances),
    )


def command_line(words: Sequence[str]) -> str:
    """Join a program's arguments as Windows programs take them apart again (CommandLineToArgvW).

    Returns:
        One line of text.
    """
    from subprocess import list2cmdline

    return list2cmdline(words)
