"""Each check tells of what it is for and of nothing else, at the address that an acceptance names."""

from dataclasses import replace

import pytest

from rarms_iac.applying.doctor import DOCTOR_ONLY_CODES, examine
from rarms_iac.applying.doctor.windows import effective_responsiveness
from rarms_iac.model.diagnostics import Diagnostic
from rarms_iac.model.host import SchedulerType
from rarms_iac.model.seen_host import Condition, PolicyScope, SeenHost
from rarms_iac.model.state import (
    HostFacts,
    Partition,
    ProcessorKind,
    RegistryValue,
    Rights,
    RunState,
    State,
    Tie,
    ValueKind,
)
from tests.builders import a_host
from tests.builders_plan import facts, partition, settings


def examination(
    *, of: HostFacts | None = None, machines: tuple[Partition, ...] = (), how: Condition | None = None
) -> SeenHost:
    state = State(facts=of or facts(), partitions=machines)
    return SeenHost(host=a_host(), application="robot", state=state, condition=how or Condition())


def how(**condition: object) -> SeenHost:
    """A host in this condition."""
    return examination(how=Condition(**condition))  # type: ignore[arg-type]  # fields, said by cases


def of(**known: object) -> SeenHost:
    """A host of which this is known."""
    return examination(of=replace(facts(), **known))  # type: ignore[arg-type]  # fields, said by cases


def responsive(data: int | str) -> Condition:
    kind = ValueKind.DWORD if isinstance(data, int) else ValueKind.SZ
    return Condition(responsiveness=RegistryValue(kind=kind, data=data))


VISION = partition(settings("vision"))
WITH_THREADS = replace(VISION, settings=replace(VISION.settings, threads="controller* at 20"))
OFF = replace(VISION, state=RunState.OFF)
WITHOUT_RIGHTS = replace(facts(), rights=Rights.UNKNOWN)
POLICY = PolicyScope
HEALTHY = Condition(
    powershell="5.1.26100.2161",
    bits=64,
    policies={POLICY.MACHINE_POLICY: "Undefined", POLICY.PROCESS: "Bypass", POLICY.LOCAL_MACHINE: "RemoteSigned"},
    module=("2.0.0.0",),
    role=True,
    hypervisor_running=True,
    counters=True,
    elevated=True,
    hyperv_administrator=False,
    script_running=False,
    seen_processors=2,
    numa_nodes=1,
)

CASES = {
    "root": ("RARMS159", "host/onboard", of(scheduler=SchedulerType.ROOT)),
    "unknown": ("RARMS166", "host/onboard", of(scheduler=SchedulerType.UNKNOWN)),
    "no rights": ("RARMS158", "host/onboard", of(rights=Rights.MISSING)),
    "rights not proven": ("RARMS158", "host/onboard", of(rights=Rights.UNKNOWN)),
    "responsiveness": ("RARMS230", "host/onboard", examination(how=responsive(15))),
    "does not have the module": ("RARMS233", "host/onboard", how(module=())),
    "SMT": ("RARMS234", "host/onboard", of(smt=True, scheduler=SchedulerType.CORE)),
    "group": ("RARMS235", "partition/vision", examination(machines=(replace(VISION, cpu_group="36ab08cb"),))),
    "unequal": ("RARMS405", "host/onboard", of(processor_kinds=(ProcessorKind(processors=8, threads=1),) * 2)),
    "thread watcher": (
        "RARMS444",
        "host/onboard",
        examination(how=Condition(thread_watcher=False), machines=(WITH_THREADS,)),
    ),
    "old PowerShell": ("RARMS233", "host/onboard", how(powershell="5.0.10586.117")),
    "policy of a group": (
        "RARMS241",
        "host/onboard",
        how(policies={POLICY.USER_POLICY: "AllSigned", POLICY.LOCAL_MACHINE: "Unrestricted"}),
    ),
    "policy of the machine": (
        "RARMS241",
        "host/onboard",
        how(policies={POLICY.PROCESS: "Bypass", POLICY.LOCAL_MACHINE: "Restricted"}),
    ),
    "no policy on a client": (
        "RARMS241",
        "host/onboard",
        examination(of=replace(facts(), client=True), how=Condition(policies={POLICY.LOCAL_MACHINE: "Undefined"})),
    ),
    "32 bits": ("RARMS233", "host/onboard", how(bits=32)),
    "minroot": ("RARMS243", "host/onboard", how(seen_processors=1)),
    "cluster": ("RARMS245", "partition/vision", examination(machines=(replace(VISION, ties=(Tie.CLUSTER,)),))),
    "critical": ("RARMS245", "partition/vision", examination(machines=(replace(VISION, state=RunState.CRITICAL),))),
    "wide": (
        "RARMS245",
        "machine/id-of-strange",
        examination(machines=(partition(settings("strange", processors=3), application=None),)),
    ),
    "mark": (
        "RARMS151",
        "machine/id-of-copy",
        examination(machines=(replace(partition(settings("copy"), application=None), foreign_mark="it was copied"),)),
    ),
    "no role": ("RARMS233", "host/onboard", examination(of=WITHOUT_RIGHTS, how=Condition(role=False))),
    "no hypervisor": ("RARMS233", "host/onboard", how(role=True, hypervisor_running=False)),
    "not elevated": ("RARMS319", "host/onboard", how(elevated=False, hyperv_administrator=True)),
    "little memory": (
        "RARMS320",
        "host/onboard",
        replace(examination(), state=State(facts=facts(), partitions=(OFF,), memory_left=OFF.settings.memory - 1)),
    ),
    "does not have the counters": ("RARMS321", "host/onboard", how(hypervisor_running=True, counters=False)),
    "mute guest": ("RARMS245", "partition/vision", examination(machines=(replace(VISION, can_be_asked=False),))),
    "running script": ("RARMS323", "host/onboard", how(script_running=True)),
    "unread": ("RARMS249", "host/onboard", how(unread={"the NUMA nodes": "denied"})),
}


@pytest.mark.parametrize("case", CASES)
def test_problem_is_told_alone_with_place(case: str) -> None:
    code, address, host = CASES[case]

    assert [(diagnostic.code, diagnostic.address) for diagnostic in examine(host)] == [(code, address)]


def test_every_check_of_the_doctor_has_a_case() -> None:
    assert {code for code, _, _ in CASES.values()} > DOCTOR_ONLY_CODES


def test_a_healthy_host_has_no_findings() -> None:
    assert examine(examination(machines=(VISION,), how=HEALTHY)) == ()


@pytest.mark.parametrize(
    ("watcher", "machine"), [(True, WITH_THREADS), (None, WITH_THREADS), (False, VISION), (False, OFF)]
)
def test_watcher_is_needed_by_running_threads(watcher: bool | None, machine: Partition) -> None:
    assert examine(examination(how=Condition(thread_watcher=watcher), machines=(machine,))) == ()


def test_host_known_by_state_is_judged() -> None:
    assert examine(examination(machines=(VISION,))) == ()


@pytest.mark.parametrize("version", ["5.1", "5.1.14393.0", "7.4.6", "10.0"])
def test_powershell_that_runs_scripts_is_not_told_of(version: str) -> None:
    assert examine(how(powershell=version)) == ()


@pytest.mark.parametrize("version", ["2.0", "3", "5.0.10586.117", "", "core"])
def test_powershell_without_needed_version_is_finding(version: str) -> None:
    assert [diagnostic.code for diagnostic in examine(how(powershell=version))] == ["RARMS233"]


def test_policy_of_the_look_counts_for_nothing() -> None:
    how = Condition(policies={POLICY.PROCESS: "Restricted", POLICY.LOCAL_MACHINE: "RemoteSigned"})

    assert examine(examination(how=how)) == ()


@pytest.mark.parametrize(
    ("scope", "word"), [(POLICY.MACHINE_POLICY, "overrides the policy of rarms"), (POLICY.CURRENT_USER, "by hand")]
)
def test_what_policy_means_depends_on_who_set_it(scope: PolicyScope, word: str) -> None:
    (finding,) = examine(how(policies={scope: "Restricted"}))

    assert word in finding.detail + str(finding.advice)


def test_root_scheduler_names_both_ways_out() -> None:
    _, _, host = CASES["root"]
    (finding,) = examine(host)

    assert "bcdedit /set hypervisorschedulertype core" in str(finding.advice)
    assert "bcdedit /set {hypervisorsettings} hypervisorschedulertype core" in str(finding.advice)


def test_a_client_is_not_sent_to_bcdedit() -> None:
    client = replace(facts(), scheduler=SchedulerType.UNKNOWN, client=True)
    (finding,) = examine(examination(of=client))

    assert ("client" in finding.detail, "bcdedit" in str(finding.advice)) == (True, False)


def test_what_provider_found_is_told_with_rest() -> None:
    told: Diagnostic = examine(CASES["root"][2])[0]

    assert examine(replace(examination(), findings=(told,))) == (told,)


@pytest.mark.parametrize(
    ("data", "means"),
    [(0, 20), (9, 20), (10, 10), (19, 10), (20, 20), (95, 90), (100, 100), (101, 20), (4294967295, 20), ("20", 20)],
)
def test_windows_rounds_responsiveness(data: int | str, means: int) -> None:
    how = responsive(data)

    assert how.responsiveness is not None
    assert effective_responsiveness(how.responsiveness) == means
    assert len(examine(examination(how=how))) == (0 if data in range(10, 100, 10) else 1)
