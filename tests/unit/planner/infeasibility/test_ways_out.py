"""Ways out of what does not fit, where reservations come from curves: each is planned again here."""

import re
from collections.abc import Iterable
from dataclasses import replace
from fractions import Fraction

from rarms_iac.model.layout import Infeasible, Layout, Relaxation, RelaxationKind
from rarms_iac.model.system import AtLeast, AtMost, PartitionRequest, System
from rarms_iac.planner.infeasibility.relaxations import _is_too_little
from rarms_iac.planner.layout import describe_possibility, in_a_list
from tests.builders import a_component, a_cpu, a_host, a_system, at_most
from tests.unit.planner.test_verdicts import Logs, a_data_log, planned

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


def logs_of(**means: dict[int, float]) -> Logs:
    """The logs of these components: by reserve, what their jobs take on the average."""
    return {(name,): a_data_log(curve, name) for name, curve in means.items()}


LOGS = logs_of(path={10: 200, 20: 90}, speech={30: 140, 40: 90}, vision={30: 210, 50: 90})
EACH_40 = logs_of(path={39: 200, 40: 90}, speech={39: 200, 40: 90}, vision={39: 200, 40: 90})


def test_apt_is_relaxed_as_little_as_possible() -> None:
    system = a_robot()  # 20, 40 and 50 per cent, less what the slopes give back

    offered = [way for way in ways(system, LOGS) if LINE.search(in_a_list(way.changes))]

    assert offered
    for way in offered:
        changed, found = relaxed(system, in_a_list(way.changes))
        ((name, value),) = found.items()
        assert fits(changed, LOGS)
        tighter = AtMost(value=Fraction(value) - 4)
        component = replace(changed.components[name], apt={"mean_response_time": tighter})
        assert not fits(replace(changed, components={**changed.components, name: component}), LOGS)


def test_several_apts_are_relaxed_together() -> None:
    system = a_robot()
    logs = logs_of(path={25: 110, 30: 90}, speech={35: 110, 40: 90}, vision={39: 110, 44: 90})

    (offered,) = [way for way in ways(system, logs) if LINE.search(in_a_list(way.changes))]

    changed, found = relaxed(system, in_a_list(offered.changes))
    assert in_a_list(offered.changes).startswith("all of these:\n  - ")
    assert len(found) > 1
    assert fits(changed, logs)
    for name in found:
        others = {**changed.components, name: system.components[name]}
        assert not fits(replace(changed, components=others), logs), f"{name} need not be relaxed"


def test_nothing_is_offered_below_what_was_measured() -> None:
    logs = logs_of(path={60: 90}, vision={55: 200, 60: 90})

    offered = ways(a_robot(("path", "vision")), logs_of(path={60: 90}, vision={60: 90}))
    assert not [way for way in offered if LINE.search(in_a_list(way.changes))]
    assert str(describe_possibility(offered[0])) == (
        "No lower setting of path and vision was measured: `rarms measure` may find a smaller reservation."
    )

    first = str(describe_possibility(ways(a_robot(("path", "vision")), logs)[0]))
    assert first.startswith("No lower setting of path was measured"), "of vision one was, and missed"


def pair_in(system: System, logs: Logs) -> str | None:
    pairs = (way for way in ways(system, logs) if way.kind is RelaxationKind.COMBINING)
    return next((str(describe_possibility(way)) for way in pairs), None)


def test_least_critical_pair_is_combined() -> None:
    system = a_robot()

    assert pair_in(system, EACH_40) == (
        "Combining components may be enough. Check with `rarms tune`: path and speech reserve 1.6 LP "
        "in two partitions on onboard; in one partition they may reserve up to 1.2 LP."
    )
    for reserve, does in (("60 %", True), ("61 %", False)):
        both = PartitionRequest(name="path", components=("path", "speech"), cpu=a_cpu(reserve=reserve))
        assert fits(replace(system, partitions={"path": both}), EACH_40) is does


def test_pair_is_combined_on_a_common_host() -> None:
    hosts = [a_host(name, platform="onboard") for name in ("front", "rear")]
    components = [
        a_component("arm", criticality=1, reserve="measured", apt=APT, hosts=["rear"]),
        a_component("base", criticality=2, reserve="measured", apt=APT, hosts=["rear"]),
        a_component("camera", criticality=3, reserve="measured", apt=APT),
    ]
    logs = logs_of(arm={59: 200, 60: 90}, base={59: 200, 60: 90}, camera={59: 200, 60: 90})

    offered = pair_in(a_system(hosts=hosts, components=components), logs)

    assert offered is not None
    assert "arm and base reserve 2.4 LP in two partitions on rear; in one partition they may reserve up to" in offered


def test_impossible_pair_is_not_offered() -> None:
    system = a_robot()
    apart = replace(system.components["path"], apart=("speech",))
    offered = pair_in(replace(system, components={**system.components, "path": apart}), EACH_40)
    assert offered is not None
    assert "path and vision reserve 1.6 LP in two partitions" in offered

    fixed = [a_component(name, reserve="40 %") for name in ("path", "speech", "vision")]
    assert pair_in(a_system(components=fixed), {}) is None, "what is fixed adds up, with any sharing"


def test_more_processors_are_promised_unless_measured_fewer() -> None:
    fixed = a_system(components=[a_component(name, reserve="0.9 LP") for name in ("arm", "base", "camera")])
    more = "one more logical processor on onboard"
    assert more in [in_a_list(way.changes) for way in ways(fixed, {}) if way.kind is RelaxationKind.CERTAIN]

    mixed = a_system(components=[*fixed.components.values(), a_component("path", reserve="measured", apt=APT)])
    found = ways(mixed, logs_of(path={5: 200, 10: 90}))

    (perhaps,) = [way for way in found if more in in_a_list(way.changes)]
    assert perhaps.kind is RelaxationKind.MORE_PROCESSORS
    assert str(describe_possibility(perhaps)) == (
        f"O{more[1:]}, with `processors: 2` for path as now may be enough. Measure the partitions there: "
        "`rarms measure`."
    )


def test_larger_host_does_not_help_growing_partitions() -> None:
    system = a_system(components=[a_component(name, reserve="40 %") for name in ("arm", "base", "camera")])

    assert not [way for way in ways(system, {}) if "logical processor" in in_a_list(way.changes)]


def test_reserve_is_lowered_as_little_as_possible() -> None:
    system = a_system(
        components=[
            a_component("arm", criticality=1, reserve="0.9 LP", processors=1),
            a_component("base", criticality=2, reserve="60 %"),
        ]
    )

    offered = [in_a_list(way.changes) for way in ways(system, {})]

    assert "arm reserves 0.4 LP instead of 0.9 LP" in offered, "0.41 LP would find 40 % on either processor"


def test_several_reserves_are_lowered_together_least_critical_first() -> None:
    shares = {"arm": 40, "base": 40, "camera": 70, "dock": 60}
    system = a_system(
        components=[
            a_component(name, criticality=at, reserve=f"{share} %") for at, (name, share) in enumerate(shares.items())
        ]
    )

    (offered,) = [in_a_list(way.changes) for way in ways(system, {})]

    assert offered.splitlines() == [
        "all of these:",
        "  - arm reserves 1 % of host instead of 40 % of host",
        "  - base reserves 1 % of host instead of 40 % of host",
        "  - camera reserves 38 % of host instead of 70 % of host",
    ]


def test_memory_is_added_and_a_reserve_lowered() -> None:
    system = a_system(
        hosts=[a_host(memory="4 GiB")],
        components=[
            a_component("arm", criticality=1, reserve="70 %", memory="3 GiB"),
            a_component("base", criticality=2, reserve="50 %", memory="2 GiB"),
        ],
    )

    assert [in_a_list(way.changes).splitlines()[1:] for way in ways(system, {})] == [
        ["  - 1 GiB more memory on onboard", "  - arm reserves 50 % of host instead of 70 % of host"],
        ["  - 1 GiB more memory on onboard", "  - base reserves 30 % of host instead of 50 % of host"],
    ]


def test_memory_and_processors_are_added_together() -> None:
    system = a_system(
        hosts=[a_host(memory="4 GiB")],
        components=[
            a_component("arm", criticality=1, reserve="1.4 LP", memory="3 GiB"),
            a_component("base", criticality=2, reserve="1 LP", memory="2 GiB"),
        ],
    )

    first = in_a_list(ways(system, {})[0].changes).splitlines()

    assert first == ["all of these:", "  - 1 GiB more memory on onboard", "  - one more logical processor on onboard"]


def test_fixed_partition_reserve_is_lowered() -> None:
    both = PartitionRequest(name="arm", components=("arm", "base"), cpu=a_cpu(reserve="70 %"))
    components = [a_component(name, reserve="40 %") for name in ("arm", "base", "camera")]

    offered = [in_a_list(way.changes) for way in ways(a_system(components=components, partitions=[both]), {})]

    assert "partition arm reserves 60 % of host instead of 70 % of host" in offered


def test_hosts_of_one_platform_stay_alike() -> None:
    hosts = [a_host(name, platform="alike") for name in ("front", "rear")]
    components = [a_component(name, reserve="1.1 LP") for name in ("arm", "base", "camera", "dock")]

    offered = [in_a_list(way.changes) for way in ways(a_system(hosts=hosts, components=components), {})]

    assert "one more logical processor on each of front and rear" in offered


def test_the_advice_says_which_help_and_which_may() -> None:

    (offered,) = [diagnostic for diagnostic in planned(a_robot(), EACH_40).findings if diagnostic.code == "RARMS014"]

    pair, more = str(offered.advice).splitlines()
    assert pair.startswith(
        "Combining components may be enough. Check with `rarms tune`: path and speech reserve 1.6 LP in two partitions"
    )
    assert more.startswith("One more logical processor on onboard, with `processors: 2` for path, speech and vision")


def test_ways_out_are_a_list() -> None:
    system = a_robot()
    more = a_component("dock", criticality=9, reserve="8 %", memory="64 MiB")
    logs = logs_of(path={24: 110, 27: 90}, speech={29: 110, 32: 90}, vision={36: 110, 39: 90})

    system = replace(system, components={**system.components, "dock": more})
    (offered,) = [diagnostic for diagnostic in planned(system, logs).findings if diagnostic.code == "RARMS014"]

    head, together, *apts = str(offered.advice).splitlines()[:4]
    assert [head, together] == ["Each of these changes alone would be enough:", "- all of these:"], str(offered.advice)
    assert len(apts) > 1
    assert all(line.startswith("  - ") and LINE.search(line) for line in apts)


def test_tuning_is_offered_for_its_host() -> None:
    system = a_robot()
    other = replace(a_host("rack", logical_processors=16), platform="server")
    placed = {name: replace(each, hosts=("onboard",)) for name, each in system.components.items()}
    two = replace(system, components=placed, hosts={**system.hosts, "rack": other})

    assert (pair_in(two, EACH_40) or "").startswith(
        "Combining components may be enough. Check with `rarms tune --host onboard`"
    )


def test_pairs_are_tuned_on_each_platform() -> None:
    components = [
        a_component(name, criticality=at, reserve="measured", apt=APT, memory="64 MiB", hosts=[host])
        for at, (name, host) in enumerate((("arm", "left"), ("base", "left"), ("eye", "right"), ("head", "right")), 1)
    ]
    hosts = [a_host(name, platform=name) for name in ("left", "right")]
    logs = logs_of(**{name: {59: 200.0, 60: 90.0} for name in ("arm", "base", "eye", "head")})

    offered = pair_in(a_system(hosts=hosts, components=components), logs) or ""

    assert offered.startswith(
        "Combining components may be enough. Check each of these with `rarms tune --host left` and "
        "`rarms tune --host right`:\n  - "
    )
    assert ("arm and base reserve" in offered, "eye and head reserve" in offered) == (True, True)


def test_half_a_rate_is_no_way_out() -> None:
    asked = AtLeast(value=Fraction(95))

    assert _is_too_little(asked, AtLeast(value=Fraction(47)))
    assert not _is_too_little(asked, AtLeast(value=Fraction(48)))
    assert not _is_too_little(AtMost(value=Fraction(100)), AtMost(value=Fraction(10)))
