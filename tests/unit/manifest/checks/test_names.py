from dataclasses import replace
from datetime import date
from unittest.mock import patch

import pytest

from rarms_iac.manifest.checks import run_checks
from rarms_iac.model.system import Policy, RunsOn, System
from tests.builders import PathPlaces, a_component, a_host, a_partition, a_system, codes, the_delivery_robot
from tests.fake_powershell.text import RESERVED
from tests.unit.manifest.checks.violations import found

VISION = a_component("vision", criticality=30)
SPEECH = a_component("speech", criticality=20)
ON_HOST = a_component("watchdog", runs_on=RunsOn.HOST)
ROOMY = a_host(keep_processor="10 %", keep_memory="1 GiB")


@pytest.mark.parametrize(
    ("system", "path"),
    [
        (a_system(components=[a_component("vision", together=["visoin"])]), "components.vision.together.0"),
        (a_system(components=[VISION, a_component("speech", apart=["vision", "x"])]), "components.speech.apart.1"),
        (a_system(components=[a_component("vision", hosts=["onboard", "x"])]), "components.vision.hosts.1"),
        (a_system(components=[a_component("vision", interference=["x"])]), "components.vision.interference"),
        (a_system(partitions=[a_partition("p", components=["vision", "x"])]), "partitions.p.components.1"),
        (a_system(partitions=[a_partition("x")]), "partitions.x.components.0"),
        (a_system(policy=Policy(interference=("x",))), "policy.interference"),
        (a_system(moved={"eyes": "x"}), "moved.eyes"),
        (a_system(moved={"eyes": "watchdog"}, components=[VISION, ON_HOST], hosts=[ROOMY]), "moved.eyes"),
    ],
)
def test_a_name_that_nothing_has(system: System, path: str) -> None:
    assert ("RARMS042", path) in found(system)


def test_names_that_are_there_are_no_finding() -> None:
    system = a_system(
        components=[a_component("vision", hosts=["onboard"], apart=["speech"], interference=["busy-loop"]), SPEECH],
        partitions=[a_partition("both", components=["vision"])],
        moved={"eyes": "both", "ears": "speech"},
    )

    assert found(system) == []
    assert codes(run_checks(the_delivery_robot(), PathPlaces(), date(2026, 1, 1))) == ["RARMS086"]


@pytest.mark.parametrize(
    ("system", "expected"),
    [
        (a_system(application="nul"), [("RARMS043", "application.name")]),
        (a_system(components=[a_component("con")]), [("RARMS043", "components.con")]),
        (a_system(hosts=[a_host("com1")]), [("RARMS043", "hosts.com1")]),
        (a_system(components=[a_component("com10"), a_component("console")]), []),
        (a_system(hosts=[a_host("vision")]), [("RARMS043", "components.vision")]),
        (
            a_system(hosts=[a_host("eyes")], partitions=[a_partition("eyes", components=["vision"])]),
            [("RARMS043", "partitions.eyes")],
        ),
        (a_system(hosts=[a_host("vision")], partitions=[a_partition("eyes", components=["vision"])]), []),
    ],
)
def test_names_that_cannot_be(system: System, expected: list[tuple[str, str]]) -> None:
    assert found(system) == expected


@pytest.mark.parametrize(
    ("moved", "expected"),
    [
        ({"vision": "vision"}, ["RARMS080"]),
        ({"eyes": "sight", "sight": "eyes"}, ["RARMS080", "RARMS080"]),
        ({"vision": "speech", "speech": "vision"}, ["RARMS080", "RARMS080"]),
        ({"eyes": "sight", "sight": "vision"}, ["RARMS042"]),
        ({"vision": "speech"}, ["RARMS080"]),
        ({"eyes": "vision", "camera": "vision"}, []),  # a fleet may have come from both
        ({"eyes": "vision", "ears": "speech"}, []),
    ],
)
def test_moves(moved: dict[str, str], expected: list[str]) -> None:
    system = a_system(components=[VISION, SPEECH], moved=moved)

    assert sorted(code for code, _ in found(system)) == expected


def test_circle_is_found_from_its_entries() -> None:
    circle = {f"p{number}": f"p{(number + 1) % 9}" for number in range(9)}
    system = a_system(components=[VISION], moved={"into": "p3", **circle, "eyes": "vision"})

    findings = run_checks(system, PathPlaces(), date(2026, 1, 1))

    in_circles = {finding.address: finding.detail for finding in findings if finding.code == "RARMS080"}
    assert set(in_circles) == {f"partition/p{number}" for number in range(9)}
    assert in_circles["partition/p7"] == "p7 -> p8 -> p0 -> p1 -> 5 more -> p7: every plan would rename them again."


@pytest.mark.parametrize(
    ("required", "codes_found"),
    [(None, []), (">=0.1", []), (">= 0.0.9", []), (">=0.1.1", ["RARMS410"]), (">=99", ["RARMS410"])],
)
def test_a_manifest_may_require_a_version(required: str | None, codes_found: list[str]) -> None:
    system = a_system(components=[VISION])
    requiring = replace(system, application=replace(system.application, requires_rarms=required))

    with patch("rarms_iac.manifest.checks.names.__version__", "0.1.0"):
        assert [code for code, _ in found(requiring)] == codes_found


@pytest.mark.parametrize("name", sorted(RESERVED))
def test_unusable_journal_name_is_refused(name: str) -> None:
    """As the stand-in for PowerShell has them: it makes no object with a property of such a name."""
    system = the_delivery_robot()

    named = replace(system, application=replace(system.application, name=name))

    assert "RARMS043" in [code for code, _ in found(named)]
    assert "RARMS043" not in [code for code, _ in found(system)]
