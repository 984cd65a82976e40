"""`rarms select`: a level, and the reservation that follows from it."""

from collections.abc import Iterator
from typing import TYPE_CHECKING

from rarms_iac.app.select import Selection
from rarms_iac.model.commands import MEASURE, Wording, prose
from rarms_iac.model.indexes import PerformanceIndex, index_named, show_range, show_threshold, show_value
from rarms_iac.model.quantities import share_of_host, share_of_processors, show_processors
from rarms_iac.views.console import paragraph, stack

if TYPE_CHECKING:
    from rich.console import RenderableType


def selection_text(selection: Selection) -> "RenderableType":
    """Return the level, the reservation and the headroom."""
    index = index_named(selection.index)
    before = "none" if selection.before is None else show_threshold(index, selection.before)
    head = f"{selection.component}: {index.name} {before} -> {show_threshold(index, selection.after)}"
    return stack(paragraph(head), *(paragraph(line, indent=2) for line in _consequences(selection, index)))


def _consequences(selection: Selection, index: PerformanceIndex) -> Iterator[Wording]:
    for level in selection.levels:
        own = share_of_processors(level.reserve, level.processors)
        share = share_of_host(level.reserved_lp, level.host_lp, level.host)
        yield f"partition {level.partition}: {show_processors(level.reserved_lp)}, {own}, {share}"
        load_suffix = f" beside {level.interference}" if level.other_loads else ""
        if level.expected is not None:
            expected = level.expected
            bounds = "so far" if index.is_extreme else f"({show_range(index, expected.lower, expected.upper)})"
            yield f"measured there{load_suffix}: {show_value(index, expected.value)} {bounds}"
        if selection.file and not level.measured_below and level.may_be_less:
            yield prose(f"no lower setting was measured{load_suffix}: ", MEASURE, " may find that less is enough")
    if not selection.depends_on_a_log:
        yield "the manifest fixes its reserve: with `cpu: { reserve: measured }` it follows the APT"
    for host, totals in selection.totals.items():
        yield f"headroom of {host}: {show_processors(totals.free_lp)} of {show_processors(totals.host_lp)}"
    if selection.why_no_headroom:
        yield f"the headroom is not known: {selection.why_no_headroom}"
