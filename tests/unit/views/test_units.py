"""The lines of units of work: one when each ends, and the time that the others may take."""

from collections.abc import Sequence
from dataclasses import replace
from fractions import Fraction

import pytest

from rarms_iac.app.control import FinishedUnit, UnitValue, WorkBegun
from rarms_iac.measuring.units import describe_work
from rarms_iac.model.experiment import experiments_of
from rarms_iac.model.system import AtLeast, AtMost
from rarms_iac.views.console import render
from rarms_iac.views.progress import MeasuringProgress, unit_line
from tests.builders import a_component, a_host, a_system

P99 = UnitValue(index="p99_response_time", value=390.0, threshold=AtMost(value=Fraction(400)), component="vision")


def a_unit(number: int) -> FinishedUnit:
    return FinishedUnit(
        number=number,
        of=12,
        subject="vision",
        load="bursts-20",
        reserved_lp=Fraction(46, 100),
        values=(P99,),
        ending="met",
    )


def test_line_of_a_unit() -> None:
    assert unit_line(a_unit(3)) == "[3/12] vision  bursts-20  0.46 LP  p99 390 ms <= 400 ms  met"


def test_line_of_a_compound_names_the_component() -> None:
    compound = replace(a_unit(3), subject="speech+vision")

    assert unit_line(compound) == "[3/12] speech+vision  bursts-20  0.46 LP  vision p99 390 ms <= 400 ms  met"


def test_unit_without_answer_has_neither_value_nor_amount() -> None:
    unit = FinishedUnit(number=1, of=2, subject="vision", load="busy-loop", ending="inconclusive")

    assert unit_line(unit) == "[1/2] vision  busy-loop  inconclusive"


def test_every_unit_is_said_at_once() -> None:
    said: list[str] = []
    progress = MeasuringProgress(lambda content: said.append(render(content)), lambda: 0.0)
    progress.work_begun(WorkBegun(units=12))
    for number in (1, 2):
        progress.unit_ended(a_unit(number))

    assert [line.split()[0] for line in said] == ["[1/12]", "[2/12]"]


def test_first_pass_is_one_line() -> None:
    said: list[str] = []
    progress = MeasuringProgress(lambda content: said.append(render(content)), lambda: 0.0)
    progress.work_begun(WorkBegun(units=12, more_follows=True))
    progress.unit_ended(a_unit(1))
    progress.unit_ended(FinishedUnit(number=2, of=12, subject="speech", load="busy-loop", ending="no answer"))
    progress.work_begun(WorkBegun(units=12))

    assert said == ["First pass: vision 0.46 LP, speech no answer.\n"]


class Row:
    """A live line that keeps what it shows."""

    def __init__(self) -> None:
        self.row: Sequence[str] = ()

    def show(self, row: Sequence[str]) -> None:
        self.row = row

    def hide(self) -> None:
        self.row = ()


@pytest.mark.parametrize(("at_most", "left"), [(False, "about 10 min left"), (True, "at most about 10 min left")])
def test_time_left_of_work_that_may_end_early(at_most: bool, left: str) -> None:
    now, row = [0.0], Row()
    progress = MeasuringProgress(lambda _content: None, lambda: now[0], row)
    progress.work_begun(WorkBegun(units=12, at_most=at_most))
    for number in (1, 2):
        now[0] += 60.0
        progress.unit_ended(a_unit(number))
    progress.proof_samples_came("onboard", None, {})

    assert row.row[-1].startswith(f"{left}, ")


def test_bound_left_counts_every_later_unit() -> None:
    now, row = [0.0], Row()
    progress = MeasuringProgress(lambda _content: None, lambda: now[0], row)
    left = []
    progress.work_begun(WorkBegun(units=3, unit_ms=180_000))
    for number in (1, 2):
        progress.proof_samples_came("onboard", None, {})
        left.append(row.row[-1])
        now[0] += 60.0
        progress.unit_ended(replace(a_unit(number), of=3))
    now[0] += 10.0
    progress.proof_samples_came("onboard", None, {})
    left.append(row.row[-1])
    progress.work_begun(WorkBegun(units=3, more_follows=True, unit_ms=180_000, later_ms=7_200_000))
    progress.proof_samples_came("onboard", None, {})

    assert [each.partition(",")[0] for each in (*left, row.row[-1])] == [
        "at most 9 min left",
        "at most 6 min left",
        "50 s to 3 min left",
        "at most 2 h 9 min left",
    ]


def test_beginning_names_the_work_and_its_bound() -> None:
    system = a_system(hosts=[a_host()], components=[a_component("vision"), a_component("speech")])
    groups = [
        experiments_of(system, system.hosts["onboard"], (name,), ("busy-loop", "bursts-20"))
        for name in ("vision", "speech")
    ]

    begins = "Measuring 2 components x 2 loads on onboard (simulated)"
    assert describe_work(groups, quick=True) == f"{begins}: 2 min to about 9 min of host time."
    assert describe_work(groups, quick=False) == f"{begins}: 2 min to about 5 h 29 min of host time."


def test_line_has_the_value_nearest_to_its_threshold() -> None:
    rate = UnitValue(index="success_rate", value=100.0, threshold=AtLeast(value=Fraction(60)), component="vision")

    assert unit_line(replace(a_unit(3), values=(rate, P99))) == unit_line(a_unit(3))
