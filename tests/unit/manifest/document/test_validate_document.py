"""What a manifest says arrives in the System, exact and whole."""

from datetime import date
from fractions import Fraction

from rarms_iac.manifest.document.validate_document import validate_document
from rarms_iac.manifest.text.positions import FirstLine
from rarms_iac.manifest.text.reading import read_text
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
    Call,
    Elapsed,
    Field,
    FromEnvironment,
    Periodic,
    Run,
    SampleCount,
    Samples,
    Stop,
    TimeField,
)
from tests.unit.manifest.examples import EVERYTHING

MIB = 2**20


def ms(value: str) -> Milliseconds:
    return Milliseconds(Fraction(value))


def system_of(text: str) -> m.System:
    return validate_document(read_text(text.encode(), "rarms.yaml", ".").value, FirstLine("rarms.yaml"))


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
        ),
        together=("speech",),
        apart=("planning",),
        dedicated=False,
        task="ObjectIdentification",
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
        measuring=m.MeasuringLimits(setting=ms("300000"), proof=ms("3600000")),
        signed_plans=True,
        accept={"RARMS041": accept},
    )
    assert SYSTEM.moved == {"ears": "senses"}
    assert SYSTEM.application == m.Application(name="cell-7", description="Says everything.", requires_rarms=">=0.1")
