"""`rarms select`: a level, and the reservation that follows from it."""

from collections.abc import Iterator
from typing import TYPE_CHECKING

from rarms_iac.app.select import SelectedLevel, Selection
from rarms_iac.model.indexes import PerformanceIndex, index_named, show_range, show_threshold, show_value
from rarms_iac.model.quantities import guaranteed, show_processors
from rarms_iac.model.wording import each_processor
from rarms_iac.views.console import paragraph, stack
from rarms_iac.views.json_output import json_of
from rarms_iac.views.output.common import output_of
from rarms_iac.views.output.measuring import HeadroomOutput, LevelOutput, SelectionOutput

if TYPE_CHECKING:
    from rich.console import RenderableType


def selection_text(selection: Selection) -> "RenderableType":
    """The level, the reservation and the headroom."""
    index = index_named(selection.index)
    before = "none" if selection.before is None else show_threshold(index, selection.before)
    head = f"{selection.component}: {index.name} {before} -> {show_threshold(index, selection.after)}"
    return stack(paragraph(head), *(paragraph(line, indent=2) for line in _consequences(selection, index)))


def selection_json(selection: Selection, file: str, *, written: bool) -> str:
    """The same for programs."""
    return json_of(
        SelectionOutput(
            component=selection.component,
            index=selection.index,
            unit=index_named(selection.index).symbol,
            before=None if selection.before is None else float(selection.before.value),
            after=float(selection.after.value),
            file=file,
            written=written,
            levels=tuple(map(_level_output, selection.levels)),
            headrooms=tuple(
                output_of(HeadroomOutput, headroom, processors=float(headroom.processors))
                for headroom in selection.headrooms
            ),
            fits=bool(selection.headrooms),
        )
    )


def _level_output(level: SelectedLevel) -> LevelOutput:
    value, lower, upper = level.expected or (None, None, None)
    return output_of(
        LevelOutput,
        level,
        reserved_processors=float(guaranteed(level.reserve, level.processors)),
        value=value,
        lower=lower,
        upper=upper,
    )


def _consequences(selection: Selection, index: PerformanceIndex) -> Iterator[str]:
    for level in selection.levels:
        amount = show_processors(guaranteed(level.reserve, level.processors))
        yield (
            f"partition {level.partition} on {level.host}: {level.reserve} % of {each_processor(level.processors)}, "
            f"{amount} of {show_processors(level.host_processors)}"
        )
        if level.expected is not None:
            value, lower, upper = level.expected
            how = "looked up" if level.interpolated else "measured"
            bounds = "so far" if index.is_extreme else f"({show_range(index, lower, upper)})"
            yield f"{how} there: {show_value(index, value)} {bounds}"
    if not selection.rests_on_a_log:
        yield "the manifest fixes its reserve: with `cpu: { reserve: measured }` it follows the APT"
    for headroom in selection.headrooms:
        whole = show_processors(headroom.host_processors)
        yield f"headroom of {headroom.host}: {show_processors(headroom.processors)} of {whole}"
    if selection.why_no_headroom:
        yield f"the headroom is not known: {selection.why_no_headroom}"
