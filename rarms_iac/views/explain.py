"""`rarms explain COMPONENT`: each value with its source, and with `--guide` how to set it up by hand, in Markdown.

The guide is for a component that cannot be changed, on hosts that rarms does not reach. It says its order.
"""

import shlex
from collections.abc import Iterator
from typing import TYPE_CHECKING

from rarms_iac.app.explain import Explanation
from rarms_iac.app.guide import GuideFacts
from rarms_iac.model.commands import prose
from rarms_iac.texts.quantities import show_reserve
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
        f"Thresholds: {'; '.join(facts.apt) or 'none'}. Its partition {facts.settings.name} gets "
        f"{show_reserve(facts.settings.reserve, facts.settings.processors)}, {facts.depends_on}."
    )
    if facts.beside:
        yield f"Other components in the partition: {', '.join(facts.beside)}."
    yield (
        "Use the section for your kind of host. Lower other reserves before you raise this one, so "
        "that the sum never exceeds the host."
    )
    yield ""


def _hyperv(facts: GuideFacts) -> Iterator[str]:
    name = facts.settings.name
    yield "## Hyper-V"
    yield ""
    yield (
        "1. In an elevated PowerShell on the host, check that the hypervisor's scheduler is not `root` "
        "(event 2 of Hyper-V-Hypervisor: launch type 4). With `root`, reserves have no effect."
    )
    yield (
        f"2. Stop the machine: `Hyper-V\\Stop-VM -Name '{name}'`. Its processors can be changed only while it is off."
    )
    yield (
        f"3. Set processors and memory: `Hyper-V\\Set-VM -Name '{name}' -ProcessorCount {facts.settings.processors} "
        f"-StaticMemory -MemoryStartupBytes {facts.settings.memory // 2**20}MB`."
    )
    yield (
        f"4. Set the reservation: `Hyper-V\\Set-VMProcessor -VMName '{name}' -Reserve {facts.settings.reserve} "
        f"-Maximum {facts.settings.limit} -RelativeWeight {facts.settings.weight}`."
    )
    yield (
        f"5. Start it: `Hyper-V\\Start-VM -Name '{name}'`. If the start fails because of processor "
        "resources, the sum of all reserves exceeds the host."
    )
    command = f", as: `{facts.command}`" if facts.command else ""
    yield f"6. In the guest, configure {facts.component} to start with Windows{command}."
    yield ""


def _mmcss(facts: GuideFacts) -> Iterator[str]:
    yield "## MMCSS, in the Windows that its threads run in (the guest)"
    yield ""
    if facts.task is None:
        yield "The component does not have a task class. No action is needed."
        yield ""
        return
    key = r"HKLM\SOFTWARE\Microsoft\Windows NT\CurrentVersion\Multimedia\SystemProfile\Tasks"
    yield (
        f"1. Add a subkey `{facts.task}` to `{key}`. Do not create the `Tasks` key again: this would "
        "erase all multimedia tasks."
    )
    yield "2. Add these values with exactly these types:"
    yield from (f"   - `{value}`" for value in facts.task_values)
    yield "3. Restart that Windows: MMCSS reads the classes when it starts."
    yield (
        "4. The component joins the class with one call, "
        f'`AvSetMmThreadCharacteristics("{facts.task}")`. If you cannot change the component, start its '
        "process with a higher priority class. The order among components is then less strict."
    )
    yield ""


def _linux(facts: GuideFacts) -> Iterator[str]:
    share = facts.settings.reserve * facts.settings.processors
    group = f"/sys/fs/cgroup/rarms.slice/{facts.settings.name}"
    yield "## Linux (control groups, version 2)"
    yield ""
    yield (
        f"1. Create the group: `mkdir -p {group}`, with `cpu`, `cpuset` and `memory` in "
        "`cgroup.subtree_control` of its parents."
    )
    yield f"2. Memory: `echo {facts.settings.memory // 2**20}M > {group}/memory.max`."
    yield (
        f"3. A reservation is a share under load. Give this group {share} of {100 * facts.host_lp} "
        f"parts: `echo {max(1, share)} > {group}/cpu.weight`. Do the same for all other groups."
    )
    if facts.settings.limit < 100:
        period = _period_us(facts.shortest_ms)
        quota = period * facts.settings.limit * facts.settings.processors // 100
        limit = show_reserve(facts.settings.limit, facts.settings.processors)
        yield (
            f"4. Set the limit of {limit}: `echo '{quota} {period}' > {group}/cpu.max`. The period is a "
            "tenth of the shortest threshold; a longer period makes response times jump in steps."
        )
    else:
        yield f"4. Keep `{group}/cpu.max` at `max`: a limit would make the measurements invalid."
    inside = shlex.quote(f"echo $$ > {group}/cgroup.procs && exec {facts.command or 'COMMAND'}")
    command = "" if facts.command else f", with the command of {facts.component} for COMMAND"
    yield f"5. Start it inside: `sh -c {inside}`{command}."
    if facts.task is not None:
        yield (
            f"6. {facts.task} is a real-time priority: run `chrt --fifo --pid 10 <thread id>` for each of "
            "its threads. A more critical component gets a higher number."
        )
    yield ""


def _check(facts: GuideFacts) -> Iterator[str]:
    yield "## Afterwards"
    yield ""
    yield (
        f"Run it under its usual load and compare with: {'; '.join(facts.apt) or 'your expectation'}. "
        "Record the settings and the date. After a change of its program, memory, processors or task "
        "class, measure again."
    )


def _period_us(shortest_ms: float | None) -> int:
    """Return a tenth of the shortest allowed response time, 1 to 100 ms."""
    return round(1000 * min(100.0, max(1.0, (shortest_ms or 1000.0) / 10)))
