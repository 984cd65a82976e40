"""`rarms explain COMPONENT`: each value with its source, and with `--guide` how to set it up by hand, in Markdown.

The guide is for a component that cannot be changed, on hosts that rarms does not reach. It says its order.
"""

import shlex
from collections.abc import Iterator
from typing import TYPE_CHECKING

from rarms_iac.app.explain import Explanation
from rarms_iac.app.guide import GuideFacts
from rarms_iac.model.commands import prose
from rarms_iac.model.quantities import show_reserve
from rarms_iac.views.console import paragraph, stack
from rarms_iac.views.table import Column, Table

if TYPE_CHECKING:
    from rich.console import RenderableType


ROWS = tuple(Column(title, wraps=True) for title in ("name", "value", "source"))


def explanation_text(explanation: Explanation) -> "RenderableType":
    """Show a row a value, with where it comes from."""
    rows = [(row.name, row.value, row.source) for row in explanation.rows]
    return stack(
        f"{explanation.component} (criticality {explanation.criticality})",
        Table(ROWS, rows),
        *(paragraph(prose("Next: ", command)) for command in explanation.commands),
    )


def guide_text(facts: GuideFacts) -> "RenderableType":
    """Return the guide in Markdown, an item or a paragraph a line: what to set, where, in which order."""
    parts = (_head, _hyperv, _mmcss, _linux, _check)
    return stack(*(paragraph(line) for part in parts for line in part(facts)))


def _head(facts: GuideFacts) -> Iterator[str]:
    yield f"# {facts.component} by hand, on {facts.platform}"
    yield ""
    yield (
        f"Good enough is: {'; '.join(facts.apt) or 'no threshold is set'}. "
        f"Its partition {facts.settings.name} gets {show_reserve(facts.settings.reserve, facts.settings.processors)}, "
        f"{facts.depends_on}."
    )
    if facts.beside:
        yield f"In the same partition run: {', '.join(facts.beside)}."
    yield (
        "Choose the section of the host's kind. Lower other reserves before raising this one, so that the host never "
        "promises more than it has."
    )
    yield ""


def _hyperv(facts: GuideFacts) -> Iterator[str]:
    name = facts.settings.name
    yield "## Hyper-V"
    yield ""
    yield (
        "1. In an elevated PowerShell on the host, see that the hypervisor's scheduler is not `root` (event 2 of "
        "Hyper-V-Hypervisor: launch type 4): under it reserves have no effect."
    )
    yield f"2. Stop the machine: `Hyper-V\\Stop-VM -Name '{name}'`. Its processors change only while it is off."
    yield (
        f"3. Set processors and memory: `Hyper-V\\Set-VM -Name '{name}' -ProcessorCount {facts.settings.processors} "
        f"-StaticMemory -MemoryStartupBytes {facts.settings.memory // 2**20}MB`."
    )
    yield (
        f"4. Set the reservation: `Hyper-V\\Set-VMProcessor -VMName '{name}' -Reserve {facts.settings.reserve} "
        f"-Maximum {facts.settings.limit} -RelativeWeight {facts.settings.weight}`."
    )
    yield (
        f"5. Start it: `Hyper-V\\Start-VM -Name '{name}'`. Over-commitment shows only here: a start that fails for "
        "processor resources means that all reserves add up to more than the host has."
    )
    command = f", as: `{facts.command}`" if facts.command else ""
    yield f"6. In the guest, have {facts.component} start with Windows{command}."
    yield ""


def _mmcss(facts: GuideFacts) -> Iterator[str]:
    yield "## MMCSS, in the Windows that its threads run in (the guest)"
    yield ""
    if facts.task is None:
        yield "It has no task class: nothing is to be set."
        yield ""
        return
    key = r"HKLM\SOFTWARE\Microsoft\Windows NT\CurrentVersion\Multimedia\SystemProfile\Tasks"
    yield (
        f"1. Add a subkey `{facts.task}` below `{key}`. "
        "Add only this one: never create the `Tasks` key again, which would erase every multimedia task."
    )
    yield "2. Give it these values, each of just this type:"
    yield from (f"   - `{value}`" for value in facts.task_values)
    yield "3. Start that Windows again: MMCSS reads the classes when it starts."
    yield (
        f'4. The component joins by one call, `AvSetMmThreadCharacteristics("{facts.task}")`. If it cannot be '
        "changed, start its process with a higher priority class, and expect less order among components."
    )
    yield ""


def _linux(facts: GuideFacts) -> Iterator[str]:
    share = facts.settings.reserve * facts.settings.processors
    group = f"/sys/fs/cgroup/rarms.slice/{facts.settings.name}"
    yield "## Linux (control groups, version 2)"
    yield ""
    yield (
        f"1. Make the group: `mkdir -p {group}`, with `cpu`, `cpuset` and `memory` in the parents' "
        "`cgroup.subtree_control`."
    )
    yield f"2. Memory: `echo {facts.settings.memory // 2**20}M > {group}/memory.max`."
    yield (
        f"3. A reservation is a share under load: among all groups that compete, give this one {share} of "
        f"{100 * facts.host_lp} parts: `echo {max(1, share)} > {group}/cpu.weight`, each other likewise."
    )
    if facts.settings.limit < 100:
        period = _period_us(facts.shortest_ms)
        quota = period * facts.settings.limit * facts.settings.processors // 100
        limit = show_reserve(facts.settings.limit, facts.settings.processors)
        yield (
            f"4. The limit of {limit}: `echo '{quota} {period}' > {group}/cpu.max`. The period is a tenth of "
            "the shortest response time that is allowed: with a longer one, response times come in steps."
        )
    else:
        yield f"4. No limit: leave `{group}/cpu.max` at `max`; a cap would falsify what was measured."
    inside = shlex.quote(f"echo $$ > {group}/cgroup.procs && exec {facts.command or 'COMMAND'}")
    command = "" if facts.command else f", with what starts {facts.component} in place of COMMAND"
    yield f"5. Start it inside: `sh -c {inside}`{command}."
    if facts.task is not None:
        yield (
            f"6. {facts.task} is a real-time priority: `chrt --fifo --pid 10 <thread id>` for each of its threads; of "
            "two components the more critical one gets the higher number."
        )
    yield ""


def _check(facts: GuideFacts) -> Iterator[str]:
    yield "## Afterwards"
    yield ""
    yield (
        f"Run it under its usual load and compare with: {'; '.join(facts.apt) or 'what you expect'}. "
        "Write down what was set and when; all that changes its program, memory, processors or task class asks for "
        "measuring again."
    )


def _period_us(shortest_ms: float | None) -> int:
    """Return a tenth of the shortest allowed response time, 1 to 100 ms."""
    return round(1000 * min(100.0, max(1.0, (shortest_ms or 1000.0) / 10)))
