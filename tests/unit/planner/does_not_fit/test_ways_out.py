"""Ways out of what does not fit, where reservations rest on curves: each is planned again here."""

import re
from collections.abc import Iterable
from dataclasses import replace
from fractions import Fraction

from rarms_iac.model.layout import Infeasible, Layout, Relaxation
from rarms_iac.model.system import AtMost, PartitionWish, System
from tests.builders import a_component, a_cpu, a_system, at_most
from tests.unit.planner.test_measured_reservations import Logs, a_log, planned

APT = {"mean_response_time": at_most(100)}
LINE = re.compile(r"([a-z]+): mean_response_time at most ([0-9.]+) ms instead of 100 ms")


def a_robot(names: Iterable[str] = ("path", "speech", "vision")) -> System:
    """As many measured components, each more critical than the one before."""
    return a_system(
        components=[
            a_component(name, criticality=at, reserve="measured", apt=APT, memory="64 MiB")
            for at, name in enumerate(names, 1)
        ]
    )


def ways(system: System, logs: Logs) -> tuple[Relaxation, ...]:
    answer = planned(system, logs).answer
    assert isinstance(answer, Infeasible)
    return answer.relaxations


def relaxed(system: System, said: str) -> tuple[System, dict[str, str]]:
    """The manifest with the thresholds of a sentence."""
    found: dict[str, str] = dict(LINE.findall(said))
    components = dict(system.components)
    for name, value in found.items():
        components[name] = replace(components[name], apt={"mean_response_time": AtMost(value=Fraction(value))})
    return replace(system, components=components), found


def fits(system: System, logs: Logs) -> bool:
    return isinstance(planned(system, logs).answer, Layout)


LOGS: Logs = {
    ("path",): a_log({10: 200, 20: 90}, "path"),
    ("speech",): a_log({30: 140, 40: 90}, "speech"),
    ("vision",): a_log({30: 210, 50: 90}, "vision"),
}


def test_an_apt_is_relaxed_by_as_little_as_makes_it_fit() -> None:
    system = a_robot()  # 20, 40 and 50 per cent, less what the slopes give back

    told = [one for one in ways(system, LOGS) if LINE.search(one.says)]

    assert told
    for one in told:
        changed, found = relaxed(system, one.says)
        ((name, value),) = found.items()
        assert fits(changed, LOGS)
        tighter = AtMost(value=Fraction(value) - 4)
        component = replace(changed.components[name], apt={"mean_response_time": tighter})
        assert not fits(replace(changed, components={**changed.components, name: component}), LOGS)


def test_where_no_apt_alone_is_enough_several_are_relaxed_together() -> None:
    system = a_robot()
    logs: Logs = {
        ("path",): a_log({25: 110, 30: 90}, "path"),
        ("speech",): a_log({35: 110, 40: 90}, "speech"),
        ("vision",): a_log({39: 110, 44: 90}, "vision"),
    }

    (told,) = [one for one in ways(system, logs) if LINE.search(one.says)]

    changed, found = relaxed(system, told.says)
    assert told.says.startswith("all of these APTs:\n  - ")
    assert len(found) > 1
    assert fits(changed, logs)
    for name in found:
        others = {**changed.components, name: system.components[name]}
        assert not fits(replace(changed, components=others), logs), f"{name} need not be relaxed"


def test_nothing_is_offered_below_what_was_measured() -> None:
    logs: Logs = {(name,): a_log({60: 90}, name) for name in ("path", "vision")}

    assert not [one for one in ways(a_robot(("path", "vision")), logs) if LINE.search(one.says)]


def test_the_pair_to_combine_is_of_the_least_critical_and_only_may_help() -> None:
    system = a_robot()
    logs: Logs = {(name,): a_log({39: 200, 40: 90}, name) for name in ("path", "speech", "vision")}

    (pair,) = [one for one in ways(system, logs) if one.may]

    assert pair.says == (
        "combining path and speech in one partition may be enough: the two need 40 % to 79 % of onboard then "
        "(predicted: 61 %), and up to 60 % fits (`rarms tune` measures it)"
    )
    for reserve, does in (("60 %", True), ("61 %", False)):
        both = PartitionWish(name="path", components=("path", "speech"), cpu=a_cpu(reserve=reserve))
        assert fits(replace(system, partitions={"path": both}), logs) is does


def test_a_pair_that_must_be_apart_or_cannot_help_is_not_offered() -> None:
    system = a_robot()
    logs: Logs = {(name,): a_log({69: 200, 70: 90}, name) for name in ("path", "speech", "vision")}
    assert not [one for one in ways(system, logs) if one.may], "70 % and 70 % are too much whatever is combined"

    logs = {(name,): a_log({39: 200, 40: 90}, name) for name in ("path", "speech", "vision")}
    apart = replace(system.components["path"], apart=("speech",))
    (pair,) = [one for one in ways(replace(system, components={**system.components, "path": apart}), logs) if one.may]
    assert pair.says.startswith("combining path and vision in one partition may be enough")


def test_the_advice_says_which_help_and_which_may() -> None:
    logs: Logs = {(name,): a_log({39: 200, 40: 90}, name) for name in ("path", "speech", "vision")}

    (told,) = [one for one in planned(a_robot(), logs).findings if one.code == "RARMS014"]

    sure, pair = told.advice.splitlines()
    assert sure == "This would fit: one more logical processor on onboard."
    assert pair.startswith("Combining path and speech in one partition may be enough: the two need 40 % to 79 %")


def test_several_ways_out_are_a_list_and_apts_that_belong_together_are_one_of_them() -> None:
    logs: Logs = {
        ("path",): a_log({25: 110, 30: 90}, "path"),
        ("speech",): a_log({35: 110, 40: 90}, "speech"),
        ("vision",): a_log({39: 110, 44: 90}, "vision"),
    }

    (told,) = [one for one in planned(a_robot(), logs).findings if one.code == "RARMS014"]

    head, together, *apts, more, _ = told.advice.splitlines()
    assert [head, together, more] == [
        "Each of these alone would fit:",
        "- all of these APTs:",
        "- one more logical processor on onboard",
    ]
    assert len(apts) > 1
    assert all(one.startswith("  - ") and LINE.search(one) for one in apts)
