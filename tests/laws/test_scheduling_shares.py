"""What the scheduler model gives to partitions that all demand: weighted max-min fairness over the whole host."""

from collections import defaultdict
from math import floor
from random import Random

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from rarms_iac.model.loads import BusyLoop
from rarms_iac.providers.simulated.scheduling.machine import (
    Entitlement,
    ModelMachine,
    TracePiece,
    VirtualMachine,
    usable_weights,
)
from rarms_iac.providers.simulated.scheduling.simulation import SchedulerSimulation
from tests.effort import examples
from tests.laws.test_scheduling_laws import machines

UNTIL_MS = 10_000.0

OFF_BY = 0.02
"""LPs by which a VP may miss its share over 10 s."""

OFF_BY_IF_FULL = 0.2
"""LPs where a VP is due nearly a whole LP: it loses turns to claims that others saved, and cannot make up."""


def busy(name: str, vps: int, weight: int, reserve: int = 0, limit: int = 100) -> VirtualMachine:
    return VirtualMachine(name=name, vps=vps, weight=weight, reserve=reserve, limit=limit, loads=(BusyLoop(),))


def got(machine: ModelMachine) -> dict[str, float]:
    """LPs that each machine had."""
    ran: dict[str, float] = defaultdict(float)

    def count(piece: TracePiece) -> None:
        ran[piece.ran.split(".")[0]] += (piece.ended - piece.began) / UNTIL_MS

    list(SchedulerSimulation(machine, 1, until_ms=UNTIL_MS, trace=count))
    return ran


def max_min(machine: ModelMachine) -> dict[str, float]:
    """LPs that each machine should have: VPs rise by weight from their reserves, to one LP or their limit at most."""
    most = {vm.name: vm.limit / 100 for vm in machine.machines}
    least = {vm.name: vm.reserve / 100 for vm in machine.machines}

    def at(level: float) -> dict[str, float]:
        return {vm.name: vm.vps * min(most[vm.name], least[vm.name] + level * vm.weight) for vm in machine.machines}

    low, high = 0.0, 1.0
    for _ in range(60):
        middle = (low + high) / 2
        low, high = (middle, high) if sum(at(middle).values()) < machine.lps else (low, middle)
    return at(high)


def assert_shared(machine: ModelMachine) -> None:
    had, wanted = got(machine), max_min(machine)
    full = any(wanted[vm.name] > 0.9 * vm.vps for vm in machine.machines)
    for vm in machine.machines:
        assert abs(had[vm.name] - wanted[vm.name]) <= (OFF_BY_IF_FULL if full else OFF_BY) * vm.vps


@pytest.mark.parametrize(("vps", "shares"), [(1, (1.0, 0.5, 0.5)), (2, (4 / 3, 1 / 3, 1 / 3))])
def test_weights_share_what_is_left_over_whole_host(vps: int, shares: tuple[float, ...]) -> None:
    weighed = tuple(busy(name, vps, weight) for name, weight in (("a", 400), ("b", 100), ("c", 100)))

    had = got(ModelMachine(lps=2, machines=weighed))

    assert [had["a"], had["b"], had["c"]] == pytest.approx(shares, abs=0.005)


@st.composite
def busy_hosts(draw: st.DrawFn) -> ModelMachine:
    lps = draw(st.integers(1, 4))
    left, hosted = 100 * lps, []
    for number in range(draw(st.integers(1, 5))):
        vps = draw(st.integers(1, lps))
        reserve = draw(st.integers(0, min(100, floor(left / vps))))
        left -= reserve * vps
        hosted.append(busy(f"vm{number}", vps, draw(st.integers(10, 1000)), reserve))
    return ModelMachine(lps=lps, machines=tuple(hosted))


@given(busy_hosts())
@settings(max_examples=examples(8), deadline=None)
def test_machine_that_always_demands_gets_its_weighted_share(machine: ModelMachine) -> None:
    assert_shared(machine)


@given(busy_hosts(), st.integers(0, 4), st.integers(1, 30))
@settings(max_examples=examples(8), deadline=None)
def test_limit_caps_share_and_others_have_rest(machine: ModelMachine, number: int, beyond: int) -> None:
    capped = machine.machines[number % len(machine.machines)]
    limited = busy(capped.name, capped.vps, capped.weight, int(capped.reserve), min(100, int(capped.reserve) + beyond))
    others = tuple(vm for vm in machine.machines if vm is not capped)
    host = ModelMachine(lps=machine.lps, machines=(limited, *others))

    assert got(host)[limited.name] <= limited.vps * limited.limit / 100 + 1e-6
    assert_shared(host)


@given(machines(), st.randoms(use_true_random=False))
@settings(max_examples=examples(8), deadline=None)
def test_order_in_which_partitions_are_listed_changes_nothing(machine: ModelMachine, shuffle: Random) -> None:
    listed = list(machine.machines)
    shuffle.shuffle(listed)
    other = ModelMachine(lps=machine.lps, machines=tuple(listed), interrupts=machine.interrupts)

    assert list(SchedulerSimulation(machine, 1, until_ms=400.0)) == list(SchedulerSimulation(other, 1, until_ms=400.0))


entitlements = st.builds(
    lambda reserve, more, weight: Entitlement(reserve / 100, min(100, reserve + more) / 100, weight),
    st.integers(0, 40),
    st.integers(1, 100),
    st.integers(1, 10_000),
)


@given(st.lists(entitlements, min_size=1, max_size=6), st.integers(1, 4))
def test_usable_weights_fill_host_and_pass_no_limit(demanding: list[Entitlement], lps: int) -> None:
    """With the lowered weights one level gives each partition its share: none passes its limit, and all is used."""
    reserved = sum(vp.reserve for vp in demanding)
    weights = usable_weights(demanding, lps)
    shared = min(float(lps), sum(vp.limit for vp in demanding)) - reserved
    if shared <= 0.0:
        return
    level = shared / sum(weights)

    assert all(weight <= vp.weight + 1e-9 for weight, vp in zip(weights, demanding, strict=True))
    for weight, vp in zip(weights, demanding, strict=True):
        assert vp.reserve + level * weight <= vp.limit + 1e-9
