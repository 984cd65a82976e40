"""What a host has promised, and what is left, once a plan is done."""

from collections.abc import Iterator
from fractions import Fraction

from rarms_iac.model.plan import HostPlan
from rarms_iac.model.quantities import in_processors, show_bytes, show_percent, show_processors

IDLE = "  not running"  # a part of the row above it


def totals_lines(part: HostPlan) -> Iterator[str]:
    """A small table of processors and memory; nothing where the plan does not say."""
    totals = part.totals
    if totals is None:
        return
    host = part.host
    processors, memory = part.facts.logical_processors, part.facts.memory
    idle = Fraction(totals.idle_percent, 100)
    kept = in_processors(host.keep_for_host.processor, processors)
    ours, others = Fraction(totals.percent, 100), Fraction(totals.others_percent, 100)
    rows = [
        ("reserved", ours, totals.memory),
        *([(IDLE, idle, totals.idle_memory)] if totals.idle_percent or totals.idle_memory else []),
        *([("unmanaged", others, totals.others_memory)] if totals.others_percent or totals.others_memory else []),
        ("kept", kept, host.keep_for_host.memory),
        (
            "free",
            processors - ours - others - kept,
            memory - totals.memory - totals.others_memory - host.keep_for_host.memory,
        ),
    ]
    widest = max(10, *(len(name) for name, _, _ in rows))
    yield ""
    yield "  Afterwards:"
    for name, amount, held in rows:
        share = show_percent(amount * 100 / processors) if processors else "0 %"
        yield f"    {name:<{widest}} {show_processors(amount):>9}  {share:>7}  {show_bytes(held):>9}"
