"""Measuring on the stand-in for Hyper-V: what it finds, what it records, and that nothing of it stays."""

import json
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path

import pytest

from rarms_iac.app import hosts as app_hosts
from rarms_iac.app.use_case_errors import UseCaseError
from rarms_iac.cli.main import main
from rarms_iac.measuring import measure
from rarms_iac.measuring.measure_request import MeasureRequest
from rarms_iac.model.outcomes import Sufficient
from rarms_iac.model.setting import LOAD_PARTITIONS
from rarms_iac.model.state import StoppedBy
from rarms_iac.providers.hyperv import provider
from rarms_iac.providers.hyperv.guest_samples import read_seen
from rarms_iac.providers.machines import read_mark
from rarms_iac.storage.datalog.files import read_log
from tests.fake_powershell import windows
from tests.fake_powershell.host import Program, WindowsHost
from tests.fake_powershell.measuring import CREDENTIAL, MANIFEST, a_measurable_windows
from tests.fake_powershell.run import put
from tests.fake_powershell.run import run as run_script
from tests.fake_powershell.transport import FakeConversation, FakePowerShellTransport
from tests.fake_powershell.values import Value

Measured = Callable[..., measure.MeasureOutcome]


@pytest.fixture
def measured(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Measured:
    """`rarms measure` with this manifest, on this host."""

    def run(host: WindowsHost, manifest: str = MANIFEST, **asked: object) -> measure.MeasureOutcome:
        (tmp_path / "rarms.yaml").write_text(manifest, encoding="utf-8")
        monkeypatch.setattr(provider, "transport_to", lambda *_: FakePowerShellTransport(host))
        request = MeasureRequest(**asked)  # type: ignore[arg-type]  # fields, said by tests
        return measure.measure_components(app_hosts.load(str(tmp_path)), request)

    return run


def leftovers(host: WindowsHost) -> list[str]:
    """What a measurement must not leave."""
    disks = [path for path in host.files if "rarms-p" in path]
    alive = [process.program for process in host.processes if process.alive]
    return [*(vm.name for vm in host.vms.values()), *disks, *alive]


def test_the_least_reservation_is_found_and_nothing_stays(measured: Measured) -> None:
    host = a_measurable_windows()

    (result,) = measured(host).experiments

    assert isinstance(result.conclusion, Sufficient)
    assert 20 < result.conclusion.reserve <= 25  # 20 ms of work in 100 ms
    assert leftovers(host) == []
    assert host.lock == ""


@pytest.mark.parametrize(("memory", "parts"), [("8 GiB", 3), ("2 GiB", 1)])
def test_parts_of_load_need_memory(measured: Measured, memory: str, parts: int) -> None:
    host = a_measurable_windows()
    reserves: dict[str, set[int]] = {}

    def look(changed: WindowsHost) -> None:
        for vm in changed.vms.values():
            reserves.setdefault(vm.name, set()).add(vm.reserve)

    host.watch = look
    (result,) = measured(host, MANIFEST.replace("8 GiB", memory).replace("1 GiB", "1536 MiB")).experiments

    assert isinstance(result.conclusion, Sufficient)
    names = [name for name in reserves if name in LOAD_PARTITIONS]
    assert names == [*LOAD_PARTITIONS[:parts]]
    file = read_log(Path(result.log))
    assert file is not None
    settings = [record.setting for _, record in file.recorded]
    of_p1 = {setting.reserve for setting in settings}  # the last part reserves as much of the LP without a VP of P1
    assert reserves[names[-1]] - {0} == (of_p1 if parts > 1 else {setting.beside for setting in settings})
    (header,) = file.headers.values()
    assert header.identity.parts.get("parts of P2", "1") == str(parts)
    assert leftovers(host) == []


def test_a_setting_carries_what_the_hypervisor_counted(measured: Measured) -> None:
    (result,) = measured(a_measurable_windows(), reserves=(40,)).experiments

    (setting,) = result.settings
    evidence = setting.evidence
    assert evidence is not None
    assert evidence.dispatch_wait_ns is not None
    assert evidence.dispatch_wait_ns["rarms-p1"] > evidence.dispatch_wait_ns["rarms-p2"] > 0
    assert evidence.cpu_ms["rarms-p1"] / evidence.elapsed_ms == pytest.approx(0.4, rel=0.05)
    assert evidence.hypervisor_ms is not None
    assert {name: time / evidence.elapsed_ms for name, time in evidence.hypervisor_ms.items()} == pytest.approx(
        {
            f"{counter_set}\\% {part} Run Time": share * processors
            for counter_set, processors in {
                "Hyper-V Hypervisor Virtual Processor(rarms-p1)": 0.4,
                "Hyper-V Hypervisor Virtual Processor(rarms-p2)": 3.56,  # 2.4 reserved, and what P1 and the root leave
                "Hyper-V Hypervisor Logical Processor": 4,
                "Hyper-V Hypervisor Root Virtual Processor": 0.04,
            }.items()
            for part, share in {"Total": 1, "Guest": 0.95, "Hypervisor": 0.05}.items()
        },
        rel=0.05,
    )
    (series,) = setting.series
    assert series.cpu_ms == pytest.approx(0.4 * series.elapsed_ms, rel=0.05)
    assert all(sample.response_ms == pytest.approx(50, rel=0.05) for sample in series.samples)


@pytest.mark.system  # 2 s of processor time, left out of a usual run
def test_a_task_class_is_not_measured_but_proven(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    host = a_measurable_windows()
    monkeypatch.setattr(provider, "transport_to", lambda *_: FakePowerShellTransport(host))
    monkeypatch.chdir(tmp_path)
    with_class = MANIFEST.replace("processors: 1", "processors: 1\n    task: SpeechRecognition")
    Path("rarms.yaml").write_text(with_class, encoding="utf-8")

    assert main(["measure"]) == 4
    refusal = " ".join(capsys.readouterr().err.split())
    assert "only after a restart; rarms does not restart it. Set its `cpu: { reserve: ... }`" in refusal
    assert leftovers(host) == []

    Path("rarms.yaml").write_text(f"{with_class}    cpu: {{ reserve: 10 % }}\n", encoding="utf-8")
    assert [main(words) for words in (["apply", "--auto-approve"], ["prove", "--load-host"])] == [0, 0], (
        capsys.readouterr()
    )


def test_lines_are_read_as_the_manifest_says(measured: Measured) -> None:
    host = a_measurable_windows(vision=Program(work_ms=20, line='{{"took": {ms:.3f}}}'))
    fields = "samples: { from: json_lines, response_time: { field: took, unit: ms } }, until"

    (result,) = measured(host, MANIFEST.replace("until", fields), reserves=(50,)).experiments

    (series,) = result.settings[0].series
    assert len(series.samples) >= 60
    assert all(sample.response_ms == pytest.approx(40, rel=0.05) for sample in series.samples)


def test_leftover_is_told_and_removed_next_time(measured: Measured) -> None:
    host = a_measurable_windows()

    def keep_machines(changed: WindowsHost) -> None:
        if changed.processes:
            changed.refusals["Remove-VM"] = ("Unspecified", "NotSpecified", "The disk is in use.")

    host.watch = keep_machines
    with pytest.raises(UseCaseError) as raised:
        measured(host, reserves=(40,))
    assert "The disk is in use." in str([finding.detail for finding in raised.value.findings])
    assert len(host.vms) == 2

    host.watch = None
    host.refusals.clear()
    (result,) = measured(host, reserves=(40,)).experiments
    assert [setting.reserve for setting in result.settings] == [40]
    assert leftovers(host) == []


def test_newest_of_merged_settings_counts(measured: Measured, monkeypatch: pytest.MonkeyPatch) -> None:
    send = FakeConversation.send

    def doubled(talk: FakeConversation, data: bytes) -> None:
        send(talk, b"1 rest." + data if b"." in data else data)

    monkeypatch.setattr(FakeConversation, "send", doubled)

    (result,) = measured(a_measurable_windows(), reserves=(40, 50)).experiments

    assert [setting.reserve for setting in result.settings] == [40, 50]


def test_job_that_closes_output_and_stays_is_late(measured: Measured) -> None:
    host = a_measurable_windows(vision=Program(work_ms=20, stays=True))
    short = MANIFEST.replace("samples: 60 }", "samples: 3 }, timeout: 1 s, failures: 9")

    (result,) = measured(host, short, reserves=(40,)).experiments

    assert {sample.failure for sample in result.settings[0].series[0].samples} == {"no exit within 1 s"}
    assert leftovers(host) == []


def test_broken_session_does_not_keep_test_partitions(measured: Measured) -> None:
    host = a_measurable_windows()
    host.refusals["Remove-PSSession"] = ("Unspecified", "NotSpecified", "The session is broken.")

    with pytest.raises(UseCaseError) as raised:
        measured(host, reserves=(40,))

    assert "The session is broken." in str([finding.detail for finding in raised.value.findings])
    assert leftovers(host) == []


def test_waiting_script_may_be_silent_as_long(measured: Measured, monkeypatch: pytest.MonkeyPatch) -> None:
    allowed: list[float] = []
    next_line = FakeConversation.next_line

    def heard(talk: FakeConversation, silence_s: float, look: Callable[[], None]) -> str | None:
        allowed.append(silence_s)
        return next_line(talk, silence_s, look)

    monkeypatch.setattr(FakeConversation, "next_line", heard)

    measured(a_measurable_windows(), reserves=(40,), lock_timeout_ms=300_000)

    assert allowed[0] == 420  # 300 s for the lock
    assert min(filter(None, allowed)) == 120  # once it is held


def test_slow_counters_do_not_pile_up(measured: Measured, monkeypatch: pytest.MonkeyPatch) -> None:
    counters, next_line = windows.counters, FakeConversation.next_line
    behind: list[int] = []

    def slowly(host: WindowsHost, counter_set: str) -> list[Value]:
        host.clock += 500
        return counters(host, counter_set)

    def heard(talk: FakeConversation, silence_s: float, look: Callable[[], None]) -> str | None:
        line = next_line(talk, silence_s, look)
        seen = read_seen(line or "")
        if seen and seen.seen.startswith("counted") and "Virtual Processor(rarms-p1)" in seen.name:
            behind.append(seen.at_ms - int(seen.seen.split(" ")[1]))
        return line

    monkeypatch.setattr(windows, "counters", slowly)
    monkeypatch.setattr(FakeConversation, "next_line", heard)
    measured(a_measurable_windows(), reserves=(40,))

    assert len(behind) > 2
    assert max(behind) < 1000


@pytest.mark.parametrize(
    ("source", "ticks"),
    [("", 330_000), ("samples: { from: json_lines, response_time: { field: took, unit: ms } }, ", 0)],
)
def test_only_process_job_is_started_by_its_period(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, source: str, ticks: int
) -> None:
    (tmp_path / "rarms.yaml").write_text(
        MANIFEST.replace("until", f"arrival: {{ every: 33 ms }}, {source}until"), encoding="utf-8"
    )
    monkeypatch.setattr(provider, "transport_to", lambda *_: FakePowerShellTransport(a_measurable_windows()))

    script, _removal = measure.measuring_scripts(app_hosts.load(str(tmp_path)))

    assert f"-PeriodTicks {ticks} " in script.text


def test_what_a_guest_prints_besides_is_passed_over() -> None:
    said = ("counted", "counted 5 x 1 1", "counted 5 1 1", "line x", "ended 1 2", "started", "", "WARNING: 5")
    lines = [
        json.dumps({"format": "rarms-seen/1", "setting": "1 rest.", "name": "p", "seen": seen, "at_ms": 1})
        for seen in said
    ]

    assert [read_seen(line) for line in lines] == [None] * len(said)
    assert read_seen(lines[0].replace("counted", "counted 5 1 2 3")) is not None


@pytest.mark.parametrize("step", [1, 9, 14, 20, 28, 31])
def test_what_killed_measurement_left_next_one_removes(measured: Measured, step: int) -> None:
    host = a_measurable_windows()
    host.kill_before = step

    with pytest.raises(UseCaseError):
        measured(host, reserves=(40,))

    host.kill_before, host.effects = None, []
    (result,) = measured(host, reserves=(40,)).experiments
    assert [setting.reserve for setting in result.settings] == [40]
    assert leftovers(host) == []


def test_guard_in_guest_ends_what_dead_session_started(measured: Measured) -> None:
    host = a_measurable_windows()

    def kill_while_it_runs(changed: WindowsHost) -> None:
        changed.kill_before = len(changed.effects) if any(process.alive for process in changed.processes) else None

    host.watch = kill_while_it_runs
    with pytest.raises(UseCaseError):
        measured(host, reserves=(40, 50))

    assert host.vms != {}  # the test partitions are not removed yet
    assert [process.program for process in host.processes if process.alive] == []


@pytest.mark.parametrize(
    ("spoil", "words"),
    [
        (lambda host: setattr(host, "guest_secret", "changed"), "The credential is invalid."),
        (lambda host: host.files.pop(CREDENTIAL.lower()), "is missing"),
        (
            lambda host: setattr(host.file(CREDENTIAL), "data", b"robot\r\nother\r\n"),
            "Write it again here, as operator",
        ),
        (lambda host: setattr(host.file(CREDENTIAL), "owner", "S-1-5-21-1"), "not to Administrators or SYSTEM"),
        (lambda host: host.programs.pop("vision.exe"), "The system cannot find the file specified."),
        (lambda host: setattr(host, "scheduler", 4), "root scheduler"),
        (lambda host: setattr(host, "lock", "held"), "locked by "),
    ],
    ids=[
        "wrong password",
        "no credential",
        "another's credential",
        "planted credential",
        "no program",
        "root scheduler",
        "held",
    ],
)
def test_what_windows_refuses_is_told_and_nothing_stays(
    measured: Measured, spoil: Callable[[WindowsHost], object], words: str
) -> None:
    host = a_measurable_windows()
    spoil(host)

    with pytest.raises(UseCaseError) as raised:
        measured(host, reserves=(40,))

    assert words in str([finding.detail for finding in raised.value.findings])
    assert leftovers(host) == []


@pytest.mark.parametrize(
    ("given", "code", "words"),
    [
        ({"what_if": True}, 0, "would be made"),
        ({"abandon": True}, 1, "a measurement has no unfinished run: start the script without -Abandon"),
        ({"lock_timeout": -5}, 1, "-LockTimeout must be 0 to 86400 seconds"),
        ({"lock_timeout": 3_000_000}, 1, "-LockTimeout must be 0 to 86400 seconds"),
    ],
    ids=["-WhatIf", "-Abandon", "too short", "too long"],
)
def test_script_by_hand_makes_nothing(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, given: dict[str, int], code: int, words: str
) -> None:
    host = a_measurable_windows()
    (tmp_path / "rarms.yaml").write_text(MANIFEST, encoding="utf-8")
    monkeypatch.setattr(provider, "transport_to", lambda *_: FakePowerShellTransport(host))
    script, _removal = measure.measuring_scripts(app_hosts.load(str(tmp_path)))
    put(host, {script.name: script.text.encode("ascii")})
    host.effects = []

    ran = run_script(host, script.name, **given)  # type: ignore[arg-type]  # switches, said by cases

    assert (ran.code, words in ran.says) == (code, True)
    assert host.effects == []


@pytest.mark.system  # 2 s of processor time, left out of a usual run
def test_what_was_measured_is_applied_and_proven(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    host = a_measurable_windows()
    monkeypatch.setattr(provider, "transport_to", lambda *_: FakePowerShellTransport(host))
    (tmp_path / "rarms.yaml").write_text(MANIFEST, encoding="utf-8")
    monkeypatch.chdir(tmp_path)

    routes = (["measure"], ["apply", "--auto-approve"], ["prove", "--load-host"])
    assert [main(words) for words in routes] == [0, 0, 0], capsys.readouterr()

    assert "ms  busy-loop  met" in capsys.readouterr().out
    ((name, reserve),) = [(vm.name, vm.reserve) for vm in host.vms.values()]
    assert name == "vision"
    assert 20 < reserve <= 23  # 20 ms of work, on average within 100 ms
    assert not any(process.alive for process in host.processes)


BURSTS = MANIFEST.replace("busy-loop", "bursts-50")


COUNTS = Program(work_ms=500, line="calibrated")
"""`bursts.ps1` on the fake: it writes its line when it has counted, and goes on."""


def test_components_begin_after_bursts_have_calibrated(measured: Measured) -> None:
    host = a_measurable_windows(powershell=COUNTS)

    (result,) = measured(host, BURSTS, reserves=(40,)).experiments

    (setting,) = result.settings
    (load,) = (process for process in host.processes if "bursts.ps1" in process.arguments)
    first = next(process for process in host.processes if process.program == "vision.exe")
    assert first.began - load.began >= COUNTS.work_ms * 100 / int(load.reserve) * 0.97
    assert setting.series[0].samples


def test_bursts_know_what_their_partition_reserves(measured: Measured) -> None:
    host = a_measurable_windows(powershell=COUNTS)

    (result,) = measured(host, BURSTS, reserves=(40, 70)).experiments
    loads = [process for process in host.processes if "bursts.ps1" in process.arguments]

    load_reserves = [setting.beside for setting in result.settings]
    assert {process.arguments for process in loads} == {"-NoProfile -ExecutionPolicy Bypass -File bursts.ps1 4 50000 0"}
    assert [int(process.reserve) for process in loads] == load_reserves
    assert load_reserves[0] > load_reserves[1] > 0
    assert leftovers(host) == []


TWO_PARTITIONS = (
    MANIFEST + "    cpu: { reserve: 7 % }\n  speech: { criticality: 5, memory: 512 MiB, cpu: { reserve: 5 % } }\n"
)
SWEEP = ("measure", "vision", "--from", "40%", "--to", "40%")
RUNNING = {"speech": ("Running", StoppedBy.NO_USER), "vision": ("Running", StoppedBy.NO_USER)}
STOPPED = {"speech": ("Off", StoppedBy.MEASUREMENT), "vision": ("Off", StoppedBy.MEASUREMENT)}


@pytest.fixture
def applied(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> WindowsHost:
    """A host on which two partitions of the manifest in this folder run; nothing is recorded of what was done."""
    host = a_measurable_windows()
    monkeypatch.setattr(provider, "transport_to", lambda *_: FakePowerShellTransport(host))
    monkeypatch.chdir(tmp_path)
    Path("rarms.yaml").write_text(TWO_PARTITIONS, encoding="utf-8")
    assert main(["apply", "--auto-approve"]) == 0
    host.effects.clear()
    return host


def machines(host: WindowsHost) -> dict[str, tuple[str, StoppedBy | None]]:
    """By name of each machine: its state, and who stopped it."""
    marks = ((vm, read_mark(vm.notes)) for vm in host.vms.values())
    return {vm.name: (vm.state, mark.stopped_by if mark else None) for vm, mark in marks}


def done_to_partitions(host: WindowsHost) -> list[str]:
    """The calls that changed machines, without those for the test partitions."""
    words = [effect.split(" ") for effect in host.effects if "-VM " in effect]
    return [f"{cmdlet} {name}" for cmdlet, name, *_ in words if not name.startswith("rarms-")]


@contextmanager
def _killed(*_: object) -> Iterator[list[object]]:
    yield []


def test_partitions_are_stopped_to_measure_and_started_again(applied: WindowsHost) -> None:
    assert main([*SWEEP, "--stop-partitions"]) == 0

    assert done_to_partitions(applied) == [
        *("Stop-VM speech", "Set-VM speech", "Stop-VM vision", "Set-VM vision"),
        *("Set-VM speech", "Set-VM vision", "Start-VM speech", "Start-VM vision"),
    ]
    assert machines(applied) == RUNNING
    assert applied.lock == ""
    assert main(["drift"]) == 0


@pytest.mark.parametrize("next_command", [SWEEP, ("start", "--auto-approve"), ("apply", "--auto-approve")])
def test_next_command_starts_what_killed_measurement_stopped(
    applied: WindowsHost, monkeypatch: pytest.MonkeyPatch, next_command: tuple[str, ...]
) -> None:
    with monkeypatch.context() as kill:
        kill.setattr(measure, "starting_again", _killed)
        assert main([*SWEEP, "--stop-partitions"]) == 0
    assert machines(applied) == STOPPED

    assert main([*next_command]) == 0

    assert machines(applied) == RUNNING


@pytest.mark.parametrize(
    ("last", "key"),
    [
        *(("Stop-VM speech", ""), ("Set-VM speech", ""), ("Stop-VM vision", ""), ("Start-VM speech", "")),
        ("Stop-VM speech", "0123456789abcdef"),  # a run that is not signed with it would not be finished
    ],
)
def test_apply_repairs_killed_stop_or_start(
    applied: WindowsHost, last: str, key: str, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    if key:
        monkeypatch.setenv("RARMS_PLAN_KEY", key)

    def kill_next(host: WindowsHost) -> None:
        if host.effects[-1].startswith(last):
            host.kill_before = len(host.effects)

    applied.watch = kill_next
    assert main([*SWEEP, "--stop-partitions"]) == 1
    applied.watch = applied.kill_before = None
    assert machines(applied) != RUNNING
    capsys.readouterr()
    assert main([*SWEEP]) == 3
    assert "error[RARMS183] Another run is unfinished on the host" in capsys.readouterr().err

    assert main(["apply", "--auto-approve"]) == 0

    assert machines(applied) == RUNNING


@pytest.mark.parametrize(
    ("field", "value", "words"),
    [
        ("clustered", "True", "belongs to a failover cluster"),
        ("notes", " robot=r2", 'has the mark of the robot "r2"'),
    ],
)
def test_stop_to_measure_refuses_what_plans_refuse(
    applied: WindowsHost, field: str, value: str, words: str, capsys: pytest.CaptureFixture[str]
) -> None:
    vision = next(vm for vm in applied.vms.values() if vm.name == "vision")
    setattr(vision, field, value if field == "clustered" else vision.notes + value)

    assert main([*SWEEP, "--stop-partitions"]) == 4

    assert words in " ".join(capsys.readouterr().err.split())
    assert done_to_partitions(applied) == []
    assert {name: state for name, (state, _) in machines(applied).items()} == {"speech": "Running", "vision": "Running"}


@pytest.mark.parametrize("spoil", [None, b"robot\r\nother\r\n"], ids=["missing", "another's"])
def test_credential_is_read_before_anything_is_made(measured: Measured, spoil: bytes | None) -> None:
    host = a_measurable_windows()
    if spoil is None:
        del host.files[CREDENTIAL.lower()]
    else:
        host.write_file(CREDENTIAL, spoil)

    with pytest.raises(UseCaseError):
        measured(host, reserves=(40,))

    assert [effect for effect in host.effects if "VM" in effect] == []
