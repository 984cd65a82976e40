"""What a manifest says arrives in the System, exact and whole."""

from collections.abc import Iterator
from datetime import date
from fractions import Fraction
from pathlib import Path
from typing import Any

import jsonschema
import pytest
from pydantic_core import ValidationError

from rarms_iac.manifest.document.marks import MOST_BROKEN
from rarms_iac.manifest.document.reader import manifest_reader
from rarms_iac.manifest.document.rules import broken_rules
from rarms_iac.manifest.document.schema import manifest_schema, overlay_schema
from rarms_iac.manifest.document.validate_document import MOST_ERRORS, NotAManifest, listable_errors, validate_document
from rarms_iac.manifest.load import load_system
from rarms_iac.manifest.text.reading import read_text
from rarms_iac.manifest.text.tree import first_line
from rarms_iac.model import loads
from rarms_iac.model import system as m
from rarms_iac.model.host import (
    Connect,
    Fault,
    FaultEffect,
    Host,
    HypervHost,
    KeepForHost,
    LinuxHost,
    Mechanism,
    ProviderKind,
    SchedulerType,
    SimulatedHost,
)
from rarms_iac.model.quantities import Bytes, LogicalProcessors, Milliseconds, Percent, ProcessorTime, ShareOfHost
from rarms_iac.model.run import (
    AttachedContainer,
    AttachedService,
    Call,
    Container,
    Elapsed,
    Field,
    FromEnvironment,
    Periodic,
    Processes,
    Run,
    SampleCount,
    Samples,
    Stop,
    TimeField,
)
from tests.unit.manifest.examples import EVERYTHING, no_checks

MIB = 2**20


def ms(value: str) -> Milliseconds:
    return Milliseconds(Fraction(value))


def system_of(text: str) -> m.System:
    return validate_document(read_text(text.encode(), "rarms.yaml", ".").value, first_line("rarms.yaml"))


SYSTEM = system_of(EVERYTHING)


def test_hosts() -> None:
    assert SYSTEM.hosts["onboard"] == Host(
        name="onboard",
        provider=ProviderKind.SIMULATED,
        logical_processors=4,
        memory=Bytes(8192 * MIB),
        keep_for_host=KeepForHost(processor=ProcessorTime(LogicalProcessors(Fraction(1, 2))), memory=Bytes(1024 * MIB)),
        system_responsiveness=30,
        platform="atom",
        connect=None,
        simulated=SimulatedHost(
            windows_build=20348,
            guest_windows_build=19045,
            scheduler=SchedulerType.CORE,
            smt=True,
            faults={
                "no-start": Fault(
                    operation="start_partition",
                    at="partition/vision",
                    effect=FaultEffect.REFUSE,
                    delay=ms("2000"),
                    times=1,
                )
            },
        ),
    )
    assert SYSTEM.hosts["server"].connect == Connect(
        ssh="operator@server", shell="powershell", port=2222, key="~/.ssh/cell", jump="gate", control_path="~/.ssh/%C"
    )
    assert SYSTEM.hosts["server"].settings == HypervHost(
        switch="robots", image="D:\\images\\base.vhdx", vm_path="D:\\machines", secure_boot="off"
    )
    assert SYSTEM.hosts["bench"].settings == LinuxHost(control_groups="v2", mechanism=Mechanism.QUOTA)
    assert SYSTEM.hosts["bench"].platform == "bench"


def test_a_component() -> None:
    assert SYSTEM.components["vision"] == m.Component(
        name="vision",
        criticality=40,
        apt={
            "mean_response_time": m.AtMost(value=Fraction(100)),
            "p99.9_response_time": m.AtMost(value=Fraction(1000)),
            "jitter": m.AtMost(value=Fraction(10)),
            "success_rate": m.AtLeast(value=Fraction(95)),
            "throughput": m.AtLeast(value=Fraction(24)),
            "deadline_miss_rate": m.AtMost(value=Fraction(1)),
        },
        run=Run(
            command=("python3", "components/vision.py", "--fast"),
            files=("components/models/*.bin",),
            environment={"LEVEL": "3", "TOKEN": FromEnvironment(name="VISION_TOKEN")},
            folder="work",
            until=SampleCount(samples=200),
            timeout=ms("30000"),
            stop=Stop(signal="INT", grace=ms("2000")),
            arrival=Periodic(period=ms("33")),
            samples=Samples(
                source="pattern",
                pattern="^ok=(?P<ok>[01]) ms=(?P<ms>[0-9.]+) n=(?P<n>[0-9]+)",
                response_time=TimeField(field="ms", unit="ms"),
                success=Field(field="ok"),
                count=Field(field="n"),
            ),
            deadline=ms("40"),
            failures=2,
        ),
        memory=Bytes(512 * MIB),
        processors=2,
        cpu=m.CpuRequest(
            reserve=ProcessorTime(LogicalProcessors(Fraction(7, 5))),
            limit=ShareOfHost(Percent(Fraction(80))),
            weight=200,
            starting=m.StartRequest(
                reserve=ProcessorTime(LogicalProcessors(Fraction(3, 2))), time=Milliseconds(Fraction(30_000))
            ),
        ),
        together=("speech",),
        apart=("planning",),
        dedicated=False,
        task=m.ThreadsTask(task_class="ObjectIdentification", threads=("detect*",)),
        hosts=("onboard", "server"),
        runs_on=m.RunsOn.PARTITION,
        interference=("browsers",),
        simulation=m.Simulation(
            work=ms("61.6"), blocked=ms("26.4"), varies=Percent(Fraction(5)), threads=2, success_within=ms("90")
        ),
    )


def test_what_is_left_out_has_its_default() -> None:
    planning, speech = SYSTEM.components["planning"], SYSTEM.components["speech"]

    assert (planning.memory, planning.runs_on, planning.cpu) == (512 * MIB, m.RunsOn.HOST, m.CpuRequest())
    assert speech.run is not None
    assert speech.run.start == Call(module="components.speech", function="listen")
    assert (speech.run.until, speech.run.deadline) == (Elapsed(time=ms("60000")), None)
    assert (speech.run.timeout, speech.run.stop) == (ms("60000"), Stop())
    assert speech.cpu.reserve is m.Measured.MEASURED


def test_deadline_of_periodic_job_is_its_period() -> None:
    run = system_of(EVERYTHING.replace("      deadline: 40 ms\n", "")).components["vision"].run

    assert run is not None
    assert run.deadline == ms("33")


def test_component_without_thresholds_reserves_nothing() -> None:
    text = EVERYTHING.replace("  planning: { criticality: 20, runs_on: host }", "  planning: { criticality: 20 }")

    assert system_of(text).components["planning"].cpu.reserve is None


def test_partitions() -> None:
    assert SYSTEM.partitions["senses"] == m.PartitionRequest(
        name="senses",
        components=("vision", "speech"),
        processors=2,
        memory=Bytes(2048 * MIB),
        cpu=m.CpuRequest(reserve=ShareOfHost(Percent(Fraction(60))), weight=100),
        protect=True,
        start=m.StartMode.MANUAL,
        stop=m.PartitionStop(grace=ms("90000")),
        hyperv=m.HypervPartition(generation=1, switch="other", image="x.vhd", vm_path="y", clustered=True),
        guest=m.Guest(connect=Connect(ssh="robot@senses"), credential="senses-admin"),
    )


def test_a_partition_holds_the_component_of_its_name() -> None:
    assert system_of(EVERYTHING + "").partitions["senses"].components == ("vision", "speech")
    text = EVERYTHING.replace("    components: [vision, speech]\n", "")
    assert system_of(text).partitions["senses"].components == ("senses",)


def test_loads_exist_without_entry_and_entry_stands_instead() -> None:
    own = system_of(EVERYTHING.replace("  busy: {", "  bursts-50: { kind: bursts, every: 60 ms }\n  busy: {"))

    assert SYSTEM.interference["busy-loop"] == loads.BusyLoop()
    assert SYSTEM.interference["bursts-50"] == loads.Bursts(every=ms("50"))
    assert SYSTEM.interference["bursts-200-half"] == loads.Bursts(every=ms("200"), duty=Percent(Fraction(50)))
    assert own.interference["bursts-50"] == loads.Bursts(every=ms("60"))


def test_the_rest() -> None:
    described = {name: load for name, load in SYSTEM.interference.items() if name not in loads.LOADS_WITHOUT_ENTRY}
    assert described == {
        "busy": loads.BusyLoop(threads=2),
        "pulses": loads.Bursts(every=ms("40"), duty=Percent(Fraction(30)), threads=2),
        "frames": loads.Bursts(every=ms("33")),
        "browsers": loads.Browser(instances=5),
        "disk": loads.CommandLoad(command=("fio", "disk.fio"), instances=2),
        "memory": loads.Stress(stressor="stream", workers=2),
    }
    assert SYSTEM.tasks == {
        "ObjectIdentification": m.TaskRequest(name="ObjectIdentification", category=m.TaskCategory.MEDIUM, priority=6),
        "Pro Audio": m.TaskRequest(
            name="Pro Audio", category=m.TaskCategory.LOW, background_priority=3, replace_shipped=True
        ),
    }
    accept = m.Acceptance(code="RARMS041", at=("partition/senses",), reason="Known.", until=date(2027, 1, 31))
    assert SYSTEM.policy == m.Policy(
        interference=("busy",),
        minimise=m.Minimise.RESERVATION,
        headroom=m.Headroom.EQUAL,
        max_disruption=m.Disruption.PARTITION_STOP,
        measuring=m.MeasuringLimits(
            setting=ms("300000"), proof=ms("3600000"), slow_job=10, precision=Percent(Fraction(5))
        ),
        signed_plans=True,
        accept={"RARMS041": accept},
    )
    assert SYSTEM.moved == {"ears": "senses"}
    assert SYSTEM.application == m.Application(name="cell-7", description="Says everything.", requires_rarms=">=0.1")


def test_processes_have_what_the_run_says() -> None:
    run = SYSTEM.components["faces"].run
    assert run is not None
    camera, detector = run.each_process.values()

    assert run.start == Processes(by_name=run.processes)
    assert (camera.user, detector.user) == ("root", "robot")
    assert (camera.groups, detector.environment_file, detector.variables) == (("video",), "robot.env", {})
    assert camera.service is not None
    assert camera.service.properties.supplementary_groups == ("video",)
    assert detector.start == Container(
        engine="podman", image="faces", command=("detect",), options=("--device=/dev/video0",)
    )


def test_attached_components_are_alone_in_their_partition() -> None:
    route, map_ = (SYSTEM.components[name] for name in ("route", "map"))

    assert route.run is not None
    assert route.run.start == AttachedContainer(container="nav2", engine="docker")
    assert map_.run is not None
    assert map_.run.start == AttachedService(service="slam")
    assert route.dedicated
    assert map_.dedicated


SCHEMAS = Path(__file__).parents[4] / "schemas"


def test_manifest_schema_is_valid_json_schema() -> None:
    meta = jsonschema.Draft202012Validator(jsonschema.Draft202012Validator.META_SCHEMA)

    assert list(meta.iter_errors(manifest_schema())) == []


def test_a_manifest_that_says_everything_fits() -> None:
    value = read_text(EVERYTHING.encode(), "rarms.yaml", ".").value

    assert list(jsonschema.Draft202012Validator(manifest_schema()).iter_errors(value)) == []


def test_the_example_says_every_field_there_is() -> None:
    said = set(_keys(read_text(EVERYTHING.encode(), "rarms.yaml", ".").value))

    fields = {name for block in _blocks() for name in block["properties"]}

    assert fields <= said


def test_every_field_has_a_description_for_the_editor() -> None:
    fields = [(name, field) for block in _blocks() for name, field in block["properties"].items()]

    silent = [name for name, field in fields if not (field.get("description") or _referred(field).get("description"))]

    assert silent == []


def _blocks() -> list[dict[str, Any]]:
    schema = manifest_schema()
    return [block for block in (schema, *schema["$defs"].values()) if "properties" in block]


def _referred(field: dict[str, Any]) -> dict[str, Any]:
    return dict(manifest_schema()["$defs"].get(field.get("$ref", "").removeprefix("#/$defs/"), {}))


def _keys(value: Any) -> Iterator[str]:
    if isinstance(value, dict):
        for key, inner in value.items():
            yield key
            yield from _keys(inner)
    if isinstance(value, list):
        for inner in value:
            yield from _keys(inner)


@pytest.mark.parametrize(
    ("run", "wrong"),
    [
        ("{ command: [a], timeout: 1 s, samples: { from: ros, input: /a, output: /b/c } }", ()),
        ("{ command: [a], samples: { from: ros, input: /a, output: /b } }", ("timeout",)),
        ("{ command: [a], timeout: 1 s, samples: { from: ros, input: /a } }", ("output",)),
        ("{ command: [a], samples: { from: json_lines, input: /a } }", ("input",)),
        ("{ call: 'a:b', timeout: 1 s, samples: { from: ros, input: /a, output: /b } }", ("call",)),
        ("{ command: [a], timeout: 1 s, samples: { from: ros, input: /a, output: /b, stream: stderr } }", ("stream",)),
        (
            "{ command: [a], timeout: 1 s, samples: { from: ros, input: /a, output: /b, success: { field: ok } } }",
            ("success",),
        ),
    ],
)
def test_samples_of_messages_have_their_own_keys(run: str, wrong: tuple[str, ...]) -> None:
    text = (
        "schema: rarms/v1\napplication: { name: cell }\nhosts: { cell: { logical_processors: 2, memory: 2 GiB } }\n"
        f"components: {{ arm: {{ criticality: 1, run: {run} }} }}"
    )
    value = read_text(text.encode(), "rarms.yaml", ".").value
    told = list(broken_rules(value))

    assert tuple(facts["key"] for _, _, facts in told) == wrong
    assert jsonschema.Draft202012Validator(manifest_schema()).is_valid(value) == (not wrong)


EXAMPLES = sorted((SCHEMAS.parent / "manifests").glob("*/rarms.yaml"))

INVALID = sorted((SCHEMAS.parent / "tests" / "cases" / "findings").glob("*/rarms.yaml"))
OF_STRUCTURE = {"RARMS015", "RARMS016", "RARMS017", "RARMS042"}
BEYOND = "This day does not exist"  # JSON Schema cannot say which days there are


@pytest.mark.parametrize("path", INVALID, ids=lambda path: path.parent.name)
def test_case_that_can_be_read_is_judged_alike(path: Path) -> None:
    read = read_text(path.read_bytes(), "rarms.yaml", str(path.parent))
    told = load_system(str(path), today=date(2026, 1, 1), checks=no_checks).diagnostics
    wrong = [each for each in told if each.code in OF_STRUCTURE and BEYOND not in each.detail]

    if read.readable and read.value is not None:
        assert jsonschema.Draft202012Validator(manifest_schema()).is_valid(read.value) == (not wrong)
    else:
        assert told
        assert not wrong


OVERLAY = jsonschema.Draft202012Validator(overlay_schema())


@pytest.mark.parametrize("file", sorted(SCHEMAS.parent.glob("manifests/*/*.yaml")), ids=lambda file: file.stem)
def test_manifests_and_overlays_are_overlays_of_some_manifest(file: Path) -> None:
    assert list(OVERLAY.iter_errors(read_text(file.read_bytes(), file.name, ".").value)) == []


@pytest.mark.parametrize(
    ("overlay", "right"),
    [
        ("components: { arm: null, door: { memory: null, task: null } }", True),
        ("components: { arm: { apt: { mean_response_time: null, jitter: { at_most: 5 ms } } } }", True),
        ("hosts: { cell: { hyperv: { switch: north } } }", True),
        ("interference: { browsers: { instances: 3 } }", True),
        ("components: { arm: { apt: { jitter: {} } } }", False),
        ("components: { arm: { run: { samples: { from: pattern } } } }", False),
        ("components: { arm: { criticalty: 3 } }", False),
        ("components: { arm: { memory: 3 } }", False),
    ],
)
def test_overlay_may_lack_and_remove_but_not_misspell(overlay: str, *, right: bool) -> None:
    assert OVERLAY.is_valid(read_text(overlay.encode(), "robot-7.yaml", ".").value) is right


def test_every_pattern_says_what_is_written_instead() -> None:
    patterns = [node for node in _nodes(manifest_schema()) if isinstance(node.get("pattern"), str)]

    silent = {node["pattern"] for node in patterns if "errorMessage" not in node}

    assert patterns
    assert silent == set()


def _nodes(value: Any) -> Iterator[dict[str, Any]]:
    if isinstance(value, dict):
        yield value
        for inner in value.values():
            yield from _nodes(inner)
    if isinstance(value, list):
        for inner in value:
            yield from _nodes(inner)


SOUND = {"criticality": 1, "memory": "64 MiB", "cpu": {"reserve": "0.1 LP"}}
WRONG = {**SOUND, "memory": 5}
HOST = {"provider": "simulated", "logical_processors": 2, "memory": "4 GiB"}


def test_errors_behind_sound_entries_are_shown() -> None:
    names = [f"c{number:04}" for number in range(60 + MOST_ERRORS + 7)]
    document = {
        "schema": "rarms/v1",
        "application": {"name": "a"},
        "hosts": {"h": HOST},
        "components": {name: SOUND if name < "c0060" else WRONG for name in names},
    }

    with pytest.raises(NotAManifest) as caught:
        validate_document(document, first_line("rarms.yaml"))

    assert [error.path[:2] for error in caught.value.errors] == [("components", name) for name in names[60:-7]]
    assert caught.value.following == 7


def test_few_errors_of_one_components_thresholds_are_shown() -> None:
    document = {
        "schema": "rarms/v1",
        "application": {"name": "a"},
        "hosts": {"h": HOST},
        "components": {"c": {**SOUND, "apt": {f"index-{number}": {} for number in range(MOST_BROKEN + 1)}}},
    }

    with pytest.raises(NotAManifest) as caught:
        validate_document(document, first_line("rarms.yaml"))

    shown = [error.path for error in caught.value.errors]
    assert shown == [("components", "c", "apt", f"index-{number}") for number in range(MOST_BROKEN)]
    assert {error.kind for error in caught.value.errors} == {"rarms_index"}


@pytest.mark.parametrize(
    ("components", "policy", "total"),
    [
        ({f"c{number}": 1 for number in range(20_000)}, {}, 20_000),
        ({f"c{number}": {**SOUND, **{f"x{key}": 1 for key in range(200)}} for number in range(100)}, {}, 20_000),
        ({f"c{number}": SOUND if number < 9000 else WRONG for number in range(20_000)}, {}, 11_000),
        ({"c": SOUND}, {"interference": [1] * 20_000}, 20_000),
        ({"c": {**{f"x{key}": 1 for key in range(20_000)}, **SOUND}}, {}, 20_000),
    ],
)
def test_flood_of_errors_is_not_listed(components: dict[str, Any], policy: dict[str, Any], total: int) -> None:
    document = {
        "schema": "rarms/v1",
        "application": {"name": "a"},
        "hosts": {"h": HOST},
        "components": components,
        "policy": policy,
    }
    with pytest.raises(ValidationError) as every:
        manifest_reader().validate_python(document)

    with pytest.raises(NotAManifest) as caught:
        validate_document(document, first_line("rarms.yaml"))

    assert listable_errors(every.value, document).error_count() <= 10_000, "listing all takes seconds and 300 MB"
    assert len(caught.value.errors) == MOST_ERRORS
    assert caught.value.following == total - MOST_ERRORS
    assert {error.kind for error in caught.value.errors} == {every.value.errors()[-1]["type"]}
