"""Which processes worked outside of the components' groups: two looks at the machine, compared."""

from collections.abc import Mapping
from dataclasses import replace
from pathlib import Path

import pytest

from rarms_iac.running import work_places
from rarms_iac.running.kernel_files import ProcessStat
from rarms_iac.running.work_places import ComponentPlace, WorkPlaces, used_ticks

EYES = ComponentPlace(component="eyes", supervisor=50, groups=())
HZ = 100


def process(name: str, ticks: int, parent: int = 1, began: int = 1000, children: int = 0) -> ProcessStat:
    return ProcessStat(name=name, parent=parent, ticks=ticks, ticks_of_children=children, began=began)


def outside(
    monkeypatch: pytest.MonkeyPatch,
    before: Mapping[int, ProcessStat],
    after: Mapping[int, ProcessStat],
    place: ComponentPlace = EYES,
) -> list[tuple[str, float]]:
    """What worked outside in ten seconds, on a machine that had run for 20 s before."""
    looks = iter((before, after))
    monkeypatch.setattr(work_places, "look", lambda: next(looks))
    monkeypatch.setattr(work_places, "ticks_since_boot", lambda: 2000)
    monkeypatch.setattr(work_places, "in_ms", lambda ticks: ticks * 1000 / HZ)
    monkeypatch.setattr(work_places, "kernel_text", lambda file: f"0::{'/box' if '51' in str(file) else '/'}\n")
    places = WorkPlaces()
    places.look([place])
    return [(work.name, work.cpu_ms) for work in places.outside([place], 10_000.0)]


SUPERVISOR = {50: process("supervisor", 1, parent=40)}


def test_daemon_counts_with_more_than_its_usual_use(monkeypatch: pytest.MonkeyPatch) -> None:
    """In the 10 s before, one used a tenth of a processor and the other a half: both use a half now."""
    before = {7: process("daemon", 100), 8: process("compiler", 500), **SUPERVISOR}
    after = {7: process("daemon", 600), 8: process("compiler", 1000), **SUPERVISOR}

    [(name, cpu_ms)] = outside(monkeypatch, before, after)
    assert name == "daemon"
    assert cpu_ms == pytest.approx(4000.0)


@pytest.mark.parametrize(
    ("own", "others", "found"),
    [
        (10, 100, [("container", 1000.0)]),
        (10, 49, []),  # less than 5 % of the setting
        (200, 100, []),  # less than the component itself
    ],
)
def test_others_matter_from_a_share_of_the_setting(
    monkeypatch: pytest.MonkeyPatch, own: int, others: int, found: list[tuple[str, float]]
) -> None:
    after = {52: process("eyes", own, parent=50), 9: process("container", others, began=2100), **SUPERVISOR}

    assert outside(monkeypatch, SUPERVISOR, after) == found


def test_ros_master_is_not_work_outside(monkeypatch: pytest.MonkeyPatch) -> None:
    after = {9: process("rosmaster", 100, began=2100), 10: process("rosout", 100, began=2100), **SUPERVISOR}

    assert outside(monkeypatch, SUPERVISOR, after) == []


def test_container_without_partition_leaves_nothing(monkeypatch: pytest.MonkeyPatch) -> None:
    after = {51: process("eyes", 200, parent=50), **SUPERVISOR}

    assert outside(monkeypatch, SUPERVISOR, after) == [("eyes", 2000.0)]
    assert outside(monkeypatch, SUPERVISOR, after, replace(EYES, has_own_group=True)) == []


def test_client_of_a_service_has_not_left(monkeypatch: pytest.MonkeyPatch) -> None:
    after = {51: process("systemd-run", 9, parent=50), 52: process("eyes", 9, parent=50), **SUPERVISOR}
    place = replace(EYES, groups=(Path("/nowhere"),), has_own_group=True)
    monkeypatch.setattr(work_places, "_group_ms", lambda _group: None)

    assert outside(monkeypatch, SUPERVISOR, after, place) == [("eyes", 90.0)]
    assert len(outside(monkeypatch, SUPERVISOR, after, replace(place, has_own_group=False))) == 2


def test_time_of_ended_children_counts_once() -> None:
    before = {1: process("init", 0), 5: process("shell", 10, children=20)}
    last = {1: process("init", 0, children=80), 5: process("shell", 30, children=50)}

    used = used_ticks(before, last, frozenset({1}))  # the shell ended, and what it had is in its parent's

    assert (used[5].own, used[5].children, used[1].children) == (20, 30, 0)


def test_work_of_an_ended_process_stays_inside(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    eyes = {51: process("eyes", 200, parent=50), **SUPERVISOR}
    looks, group = iter((SUPERVISOR, eyes, SUPERVISOR)), replace(EYES, groups=(tmp_path,))
    monkeypatch.setattr(work_places, "look", lambda: next(looks))
    monkeypatch.setattr(work_places, "kernel_text", lambda file: Path(file).read_text() if file.exists() else "0::/box")
    monkeypatch.setattr(work_places, "_group_ms", lambda _group: None)
    monkeypatch.setattr(work_places, "in_ms", float)
    (tmp_path / "cgroup.procs").write_text("51\n")
    places = WorkPlaces()
    places.look([group])
    (tmp_path / "cgroup.procs").write_text("")  # it has ended
    places.look([group])

    assert places.outside([group], 10_000.0) == ()
