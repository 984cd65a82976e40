"""What is asked at a terminal, with the help that `?` shows, and `rarms select`: a level and the reservation for it."""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING

from rarms_iac.app.report_model import Report
from rarms_iac.app.select import BeyondMeasured, SelectedLevel, Selection
from rarms_iac.measuring.level_prompt import CombiningOffer
from rarms_iac.measuring.measure_request import ExperimentResult
from rarms_iac.model.commands import MEASURE, Wording, prose
from rarms_iac.model.indexes import PerformanceIndex, index_named
from rarms_iac.planner.combining.oracle import Members
from rarms_iac.texts.indexes import show_range, show_threshold, show_value
from rarms_iac.texts.messages import counted, in_a_row
from rarms_iac.texts.quantities import share_of_processors, show_lp_percent, show_processors
from rarms_iac.views.console import paragraph, stack
from rarms_iac.views.table import Column, Table

if TYPE_CHECKING:
    from rich.console import RenderableType


LEVELS = (
    Column("partition", wraps=True),
    Column("host", wraps=True, if_differs=True),
    Column("reservation", right=True, unit="LP"),
    Column("CR", right=True),
    Column("measured", wraps=True),
    Column("load", wraps=True),
)


def selection_text(selection: Selection) -> "RenderableType":
    """Return the level, the reservations for it with the values measured there, and the headroom."""
    index = index_named(selection.index)
    before = "none" if selection.before is None else show_threshold(index, selection.before)
    head = f"{selection.component}: {index.name} {before} -> {show_threshold(index, selection.after)}"
    rows = [
        (
            level.partition,
            level.host,
            level.reserved_lp,
            share_of_processors(level.reserve, level.processors),
            _measured(level, index),
            level.interference,
        )
        for level in selection.levels
    ]
    remarks = (paragraph(line, indent=2, more=2) for line in _remarks(selection))
    return stack(paragraph(head), Table(LEVELS, rows, indent=2), *remarks)


def _measured(level: SelectedLevel, index: PerformanceIndex) -> str:
    if level.expected is None:
        return ""
    bounds = "so far" if index.is_extreme else f"({show_range(index, level.expected.lower, level.expected.upper)})"
    return f"{show_value(index, level.expected.value)} {bounds}"


def _remarks(selection: Selection) -> Iterator[Wording]:
    for level in selection.levels:
        if selection.file and not level.measured_below and level.may_be_less:
            load = f" under {level.interference}" if level.interference else ""
            lower = f"No lower reservation of {level.partition} was measured{load}. "
            yield prose(lower, MEASURE, " may find a smaller reservation.")
    if not selection.depends_on_a_log:
        yield "The manifest fixes the reservation. To use the measured reservation, set `cpu: { reserve: measured }`."
    for host, totals in selection.totals.items():
        yield f"Headroom of {host}: {show_processors(totals.free_lp)} of {show_processors(totals.host_lp)}."
    if selection.why_no_headroom:
        yield f"The headroom is not known: {selection.why_no_headroom}."


@dataclass(frozen=True, slots=True, kw_only=True)
class Question:
    """A question, and the answer to `?`."""

    text: str
    help_text: str


WRITE_LEVEL = Question(
    text="Write this level into the manifest?",
    help_text=("y: write the level as the component's `apt`; comments stay. n: do not change the manifest. q: end."),
)
WRITE_PARTITIONS = Question(
    text="Write these partitions into the manifest?",
    help_text="y: write `partitions`; comments stay. n: do not change the manifest. q: end.",
)


def level_question(component: str) -> Question:
    """Ask which level is good enough for a component."""
    return Question(
        text=f"\nA level for {component}, such as 100 ms or 95 %, or Enter to continue [?, q]: ",
        help_text=(
            "A level is a threshold with its unit: 100 ms, 95 %, 24 /s. If it fits several indexes, begin "
            "with the index: p99_response_time 100 ms. rarms shows the result before it changes the manifest. Enter "
            "continues, q ends."
        ),
    )


def refine_question(written: Selection) -> Question:
    """Ask whether to search below measured reservations, where none close below them was measured."""
    gaps = sorted({(level.measured_below, level.reserve) for level in written.levels if level.may_be_less})
    named = in_a_row([f"{below} and {reserve} % of its VPs" for below, reserve in gaps])
    return Question(
        text=f"Nothing between {named} was measured. Search there?",
        help_text="y: search for the smallest reservation there. n: use the measured settings. q: end.",
    )


def extend_question(beyond: BeyondMeasured) -> Question:
    """Ask whether to measure higher settings, since no measured one reaches a level."""
    reserves = f"{beyond.first} to {beyond.last} %" if beyond.first < beyond.last else f"{beyond.last} %"
    reserves += " of its VPs"
    return Question(
        text=f"{reserves} is not measured yet. Measure there?",
        help_text="y: measure there and evaluate the level again. n: enter another level. q: end.",
    )


def stop_question(host: str, partitions: Sequence[str]) -> Question:
    """Ask whether partitions may be stopped to measure."""
    s, runs, them = ("", "runs", "it") if len(partitions) == 1 else ("s", "run", "them")
    running = f"The partition{s} {in_a_row(partitions)} {runs} on {host}."
    return Question(
        text=f"{running} Stop {them} while measuring, and start {them} again afterwards?",
        help_text=f"y: stop {them} like `rarms stop`, and start {them} afterwards. n: do not measure. q: end.",
    )


def attach_question(components: Sequence[str]) -> Question:
    """Ask whether services and containers that run already may be slowed down to measure."""
    runs, pronoun = ("runs", "it") if len(components) == 1 else ("run", "them")
    return Question(
        text=(
            f"{in_a_row(components)} already {runs}. Limit {pronoun} while measuring, and restore the settings "
            f"afterwards?"
        ),
        help_text="y: apply the reservation of each setting. n: do not measure. q: end.",
    )


def combine_question(offer: CombiningOffer) -> Question:
    """Ask whether to combine components, since they need more than there is."""
    need, have = (show_lp_percent(amount) for amount in (offer.need, offer.have))
    then = "" if offer.predicted is None else f", predicted {show_lp_percent(offer.predicted)} combined"
    misfit = "" if offer.need > offer.have else ", but no placement on the hosts"
    return Question(
        text=f"Need {need}, have {have}{misfit}{then}. Combine components?",
        help_text="y: ask before each combination is measured, like `rarms tune --interactive`. q: end.",
    )


def combination_question(members: Members, settings: int, gain: int) -> Question:
    """Ask whether to measure this combination."""
    saves = show_lp_percent(gain)
    return Question(
        text=f"Try {in_a_row(members)}? About {counted(settings, 'setting')}, or fewer; saves at most {saves}.",
        help_text="y: measure them together and save each result. n: try another combination. q: end.",
    )


def curves_text(result: ExperimentResult, report: Report, *, ascii_only: bool) -> "RenderableType":
    """Return the settings, a plot an index, and what all reservations add up to."""
    from rarms_iac.views.measure import settings_text
    from rarms_iac.views.reports.terminal import legend, terminal_plot
    from rarms_iac.views.status import fit_text

    parts: list[RenderableType] = ["", settings_text(result)]
    for measurement in report.measurements:
        if measurement.decides and measurement.components == result.experiment.setup.members:
            for index in measurement.indexes:
                parts += ["", terminal_plot(measurement, index, ascii_only=ascii_only)]
            parts.append(legend(ascii_only=ascii_only))
    parts += [paragraph(f"{', '.join(fit.hosts)}: {fit_text(fit)}") for fit in report.capacities]
    return stack(*parts)
