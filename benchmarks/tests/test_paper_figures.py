"""The paper's numbers hold on the simulated host, with the delivery robot's shipped parameters."""

from collections.abc import Callable
from itertools import pairwise

import pytest

from benchmarks.paper.drawing import Chart, draw
from benchmarks.paper.experiments import FDP, PPP, SRP, VSP, Loaded, figure_1, figure_3, figure_4
from tests.effort import examples

SEEDS = (11, 12)  # others than the page's


@pytest.fixture(scope="module")
def curve() -> dict[int, float]:
    return figure_1(examples(60), SEEDS)


@pytest.fixture(scope="module")
def three() -> list[Loaded]:
    """Without browsers; at 32, 48 and 63 % of utilisation, at 79, 86 and 94 %, and twice at all that there is."""
    return figure_3(examples(6_000), (*SEEDS, 13, 14), browsers=(0, 4, 6, 8, 10, 11, 12, 13, 14))


@pytest.fixture(scope="module")
def four() -> dict[tuple[int, int], dict[int, float]]:
    return figure_4(examples(50), SEEDS, browsers=(1, 2, 5, 10))


def test_figure_1_begins_at_600_to_800_ms(curve: dict[int, float]) -> None:
    assert 600 <= curve[10] <= 800


def test_figure_1_falls_up_to_70_per_cent(curve: dict[int, float]) -> None:
    falling = [curve[cr] for cr in range(10, 71, 10)]

    assert all(before > after for before, after in pairwise(falling))


def test_figure_1_ends_at_88_ms(curve: dict[int, float]) -> None:
    assert all(curve[cr] == pytest.approx(88, rel=0.05) for cr in (70, 80, 90, 100))


def test_papers_walk_for_100_ms_ends_at_70(curve: dict[int, float]) -> None:
    finer = figure_1(examples(60), SEEDS, reserves=range(60, 66))

    assert min(cr for cr, ms in curve.items() if ms <= 100) == 70
    assert min(cr for cr, ms in finer.items() if ms <= 100) in range(61, 64)


def test_figure_3_task_classes_do_not_change(three: list[Loaded]) -> None:
    free = three[0]

    assert three[-1].utilisation > 99
    for name in (FDP, SRP):
        assert all(point.response_ms[name] == pytest.approx(free.response_ms[name], rel=0.03) for point in three)
        assert all(point.success_rate[name] == 100 for point in three)


REPEATS = 0.05
"""What single runs of VSP differ by at 80 % (their standard deviation is 5 to 6 %): a smaller loss is noise."""


def loss_of_ppp(loaded: Loaded, free: Loaded) -> float:
    return loaded.response_ms[PPP] / free.response_ms[PPP] - 1


def loss_of_vsp(loaded: Loaded, free: Loaded) -> float:
    return 1 - loaded.throughput[VSP] / free.throughput[VSP]


@pytest.mark.parametrize("loss", [loss_of_ppp, loss_of_vsp])
def test_figure_3_ordinary_threads_degrade_above_70(
    three: list[Loaded], loss: Callable[[Loaded, Loaded], float]
) -> None:
    free, *rest = three
    below = [loss(point, free) for point in rest if point.utilisation < 70]
    above = [loss(point, free) for point in rest if point.utilisation > 70]

    assert [len(below), len(above)] == [3, 5]
    assert max(below) < REPEATS
    assert all(before < after for before, after in pairwise([max(below), *above])), "ever worse"
    assert above[1] > 2 * REPEATS, "at 86 % it is no noise"
    assert above[-1] > 0.5


def test_figure_4_without_browsers_all_reserves_do() -> None:
    free = figure_4(examples(400), SEEDS, browsers=(0,))  # 5 % of variation need more jobs to tell 88.7 from 88

    assert all(88 <= line[0] <= 100 for line in free.values())


def test_figure_4_peaks_at_few_browsers(four: dict[tuple[int, int], dict[int, float]]) -> None:
    for line in four.values():
        highest = max(line.values())
        assert highest in (line[1], line[2])
        assert 184 <= highest <= 194


def test_figure_4_falls_again_at_ten_browsers(four: dict[tuple[int, int], dict[int, float]]) -> None:
    for line in four.values():
        assert 150 <= line[10] <= 175
        assert line[10] < 0.9 * max(line.values())


def test_chart_names_lines_and_is_deterministic() -> None:
    chart = Chart(title="A & B", across="x", up="y", lines={"one": [(0, 0), (1, 5)]}, span=(0, 1), most=10)

    assert draw(chart) == draw(chart)
    assert "A &amp; B" in draw(chart)
    assert '<polyline points="60.0,268.0 544.0,161.0"' in draw(chart)
