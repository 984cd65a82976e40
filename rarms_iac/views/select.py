"""`rarms select`: a level, and the reservation that follows from it."""

from collections.abc import Iterator
from fractions import Fraction

from rarms_iac.app.select import SelectedLevel, Selection
from rarms_iac.model.indexes import PerformanceIndex, find_index, show_threshold, show_value
from rarms_iac.model.quantities import guaranteed, show_percent, show_processors
from rarms_iac.views.as_json import as_json
from rarms_iac.views.output.measuring import HeadroomOutput, LevelOutput, SelectionOutput


def selection_text(selection: Selection) -> str:
    """The level, the reservation and the headroom, complete without colour."""
    return "\n".join(_lines(selection, _index(selection))) + "\n"


def selection_json(selection: Selection, file: str, *, written: bool) -> str:
    """The same for programs."""
    return as_json(
        SelectionOutput(
            component=selection.component,
            index=selection.index,
            before=None if selection.before is None else float(selection.before.value),
            after=float(selection.after.value),
            file=file,
            written=written,
            levels=tuple(map(_level_output, selection.levels)),
            headrooms=tuple(
                HeadroomOutput(host=headroom.host, processors=float(headroom.processors))
                for headroom in selection.headrooms
            ),
            fits=bool(selection.headrooms),
        )
    )


def _level_output(level: SelectedLevel) -> LevelOutput:
    value, lower, upper = level.expected or (None, None, None)
    return LevelOutput(
        platform=level.platform,
        partition=level.partition,
        reserve=level.reserve,
        processors=level.processors,
        interpolated=level.interpolated,
        value=value,
        lower=lower,
        upper=upper,
    )


def _index(selection: Selection) -> PerformanceIndex:
    found = find_index(selection.index)
    assert found is not None, "a level is of an index that there is"
    return found


def _lines(selection: Selection, index: PerformanceIndex) -> Iterator[str]:
    before = "none" if selection.before is None else show_threshold(index, selection.before)
    yield f"{selection.component}: {index.name} {before} -> {show_threshold(index, selection.after)}"
    for level in selection.levels:
        share = show_percent(100 * guaranteed(level.reserve, level.processors) / level.host_processors)
        each = f"{level.reserve} % of each of its {level.processors} virtual processors, {share} of {level.host}"
        yield f"  reservation on {level.platform}: {each}"
        if level.expected is not None:
            value, lower, upper = (show_value(index, Fraction(each).limit_denominator(10)) for each in level.expected)
            how = "looked up" if level.interpolated else "measured"
            yield f"  {how} there: {value} ({lower} to {upper})"
    if not selection.rests_on_a_log:
        yield "  the manifest fixes its reserve: say `cpu: { reserve: measured }`, and it follows the APT"
    for room in selection.headrooms:
        share = show_percent(100 * room.processors / room.host_processors)
        yield f"  left on {room.host}: {show_processors(room.processors)}, {share}"
    if selection.why_no_headroom:
        yield f"  no room is left to tell of: {selection.why_no_headroom}"
