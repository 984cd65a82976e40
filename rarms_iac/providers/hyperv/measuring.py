"""Measuring on a Hyper-V host: one script makes P1 and P2, runs components and loads inside guests, and removes all.

rarms tells it the next setting (`3 run 45 55.`) and hears lines: what guests said, and what the hypervisor counted. A
guest's lines carry the times of its own clock, in which durations are; where they lie on the host's is known to 0.1 s.
"""

from base64 import b64encode
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import ExitStack, contextmanager
from dataclasses import dataclass, field
from pathlib import Path
from typing import assert_never

from rarms_iac.model.diagnostics import has_errors
from rarms_iac.model.host import Host, HypervHost
from rarms_iac.model.measurement import Bench, Sample, SettingEvidence, run_of
from rarms_iac.model.quantities import show_milliseconds
from rarms_iac.model.run import Call, Command, Elapsed, FromEnvironment, Periodic, Run, SampleCount
from rarms_iac.model.state import HostFacts
from rarms_iac.model.system import Browser, BusyLoop, CommandLoad, Component, Interference, Stress
from rarms_iac.planner.sizes import suggested_secure_boot
from rarms_iac.powershell.inspection.allowed import ScriptKind
from rarms_iac.powershell.inspection.inspect import inspect
from rarms_iac.powershell.measuring import GuestWork, TestMachine, render_measuring, script_name
from rarms_iac.providers.channel import SilenceTimeout
from rarms_iac.providers.hyperv.bootstrap import arguments_of
from rarms_iac.providers.hyperv.run import LiveHypervHost, read_event
from rarms_iac.providers.hyperv.transport import ScriptSession, Transport
from rarms_iac.providers.interface import (
    NO_WAITING,
    EventKind,
    EventStatus,
    HostFailed,
    HostRefused,
    RunEvent,
    ScriptBundle,
    ScriptExited,
    WaitLimits,
)
from rarms_iac.providers.measuring import PartitionShape, PartitionWork, Work
from rarms_iac.running.loads import FLAGS, HERE
from rarms_iac.running.reading import JobAnswer, Unreadable, answer_reader
from rarms_iac.running.start import PERIOD_VARIABLE
from rarms_iac.storage.codec import NotDecodable
from rarms_iac.storage.digest import parse_json

MEMORY_MS = 100.0
"""How long the past influences the hypervisor's scheduling. No page tells; taken as the simulated host has it."""

SILENCE_S = 120.0
"""A script that measures writes a line every second; one that waits for guests, every three seconds."""

LARGEST_FILES = 4 * 2**20
"""Bytes of a component's files that travel inside the script."""

FORMAT = "rarms-seen/1"
EDGE = "C:\\Program Files (x86)\\Microsoft\\Edge\\Application\\msedge.exe"
"""The browser that every Windows has."""

BUSY_LOOP = ("powershell.exe", "-NoProfile", "-Command", "while ($true) { }")
_TICKS = 10_000.0
"""Of 100 ns, in which the hypervisor counts, to a millisecond."""


class HypervMeasuringHost(LiveHypervHost):
    """A `ScriptedMeasuringHost`."""

    def __init__(
        self, host: Host, transport: Transport, signed: Path | None, base: Path, credentials: Mapping[str, str]
    ) -> None:
        """Prepare; nothing is read before the first call.

        Args:
            host: as the manifest describes it.
            transport: the way to it.
            signed: as of `LiveHypervHost`.
            base: the manifest's folder, where the files of components lie.
            credentials: by partition, under which name the host keeps what its guest is entered with.
        """
        super().__init__(host, transport, signed)
        self._base = base
        self._credentials = credentials
        self._settings = host.settings if isinstance(host.settings, HypervHost) else HypervHost()
        self._shapes: tuple[PartitionShape, ...] = ()
        self._reserves: Mapping[str, int] = {}
        self._waits = NO_WAITING
        self._ends = ExitStack()  # the session that measures now
        self._session: ScriptSession | None = None
        self._runs: tuple[GuestWork, ...] = ()  # what that session was started with
        self._number = 0  # of the setting

    def bench(self) -> Bench:
        """See the interface."""
        facts = self.observe().facts
        return Bench(
            provider=facts.provider,
            processor=facts.computer_name,
            logical_processors=facts.logical_processors,
            smt=facts.smt,
            scheduler=facts.scheduler,
            guest_image=self._settings.image or "",
            os_build=facts.os_build,
        )

    @property
    def scheduler_memory_ms(self) -> float:
        """See the interface."""
        return MEMORY_MS

    @contextmanager
    def lock(self, owner: str, timeout_ms: int = 0) -> Iterator[None]:  # noqa: ARG002 - a script names its own
        """See the interface: the script that measures holds the host, for as long as there are test partitions."""
        self._waits = WaitLimits(lock_ms=timeout_ms)
        yield

    def obstacle(self, subject: Component | Interference) -> str:
        """See the interface."""
        if not self._settings.image:
            return "the host has no `hyperv.image` from which its test partitions could be made"
        if isinstance(subject, Stress):
            return "stress-ng is no program of Windows"
        if not isinstance(subject, Component):
            return ""
        if subject.task is not None:
            return "its task class counts in a guest only after that has restarted, which rarms does not do there yet"
        return "it has no `run`" if subject.run is None else self._obstacle_of_run(subject.run)

    def _obstacle_of_run(self, run: Run) -> str:
        if isinstance(run.start, Call):
            return "its `run` calls a Python function, and guests run commands only"
        if taken := [name for name, value in run.environment.items() if isinstance(value, FromEnvironment)]:
            return f"{taken[0]} comes from rarms' own environment, and would stand in a script"
        try:
            size = sum((self._base / run.folder / name).stat().st_size for name in run.files)
        except OSError as problem:
            return f"a file of its `run` cannot be read: {problem}"
        return "" if size <= LARGEST_FILES else f"its files have {size} bytes: put them into the image"

    @contextmanager
    def test_partitions(self, shapes: Sequence[PartitionShape]) -> Iterator[None]:
        """See the interface."""
        self._shapes = tuple(shapes)
        try:
            yield
        finally:
            self._shapes = ()
            self._end_session()

    def set_reserves(self, reserves: Mapping[str, int]) -> None:
        """See the interface."""
        self._reserves = dict(reserves)

    def remove_test_partitions(self) -> None:
        """See the interface."""
        with self._started(self._script(self.name, (), ()), lambda event: event.status is EventStatus.DONE):
            pass

    def measuring_script(
        self, application: str, shapes: Sequence[PartitionShape], partitions: Sequence[PartitionWork]
    ) -> str:
        """See the interface."""
        script = self._script(application, shapes, self._guest_works(partitions, shapes))
        return script.files[script.runs]

    @contextmanager
    def run(self, work: Work) -> Iterator["GuestRun"]:
        """See the interface."""
        works = self._guest_works(work.partitions, self._shapes)
        if self._session is None or works != self._runs:
            self._end_session()
            script = self._script(work.application, self._shapes, works)
            ready = self._started(script, lambda event: event.detail == "ready")
            self._session, self._runs = self._ends.enter_context(ready), works
        self._number += 1
        reserves = " ".join(str(self._reserves.get(shape.name, 0)) for shape in self._shapes)
        setting = f"{self._number} run {reserves}".rstrip() + "."
        self._session.send(setting)
        try:
            yield GuestRun(host=self, session=self._session, setting=setting, work=work)
        except BaseException:
            self._end_session()
            raise
        if self._shapes:
            self._number += 1
            self._session.send(f"{self._number} rest.")
        else:
            self._end_session()

    def next_line(self, session: ScriptSession) -> str:
        """Return the next line of a script that is to go on.

        Args:
            session: in which it runs.

        Returns:
            A line of its output, whatever it is.

        Raises:
            HostRefused: the script refused to go on.
            HostFailed: it failed, ended, or says nothing any more.
        """
        try:
            line = session.next_line(SILENCE_S)
        except SilenceTimeout:
            raise self._broken(f"the script said nothing for {SILENCE_S:.0f} s") from None
        if line is None:
            match session.ended():
                case ScriptExited(code=code, last_lines=lines):
                    raise self._broken(f"the script ended with {code}: {' '.join(lines[-2:]) or 'and no word why'}")
                case lost:
                    raise self._broken(f"the script was lost: {lost.why}")
        event = read_event(line)
        if event is not None and event.status is EventStatus.REFUSED:
            raise HostRefused(self.name, event.detail, "mend that, then measure again: what is recorded is kept")
        if event is not None and event.kind is EventKind.FAILED:
            raise self._broken(event.detail)
        return line

    def _broken(self, message: str) -> HostFailed:
        return HostFailed(self.name, message, "measure again: what is recorded is kept, and what is there is removed")

    @contextmanager
    def _started(self, script: ScriptBundle, is_ready: Callable[[RunEvent], bool]) -> Iterator[ScriptSession]:
        """Run a script, from when it says a certain thing."""
        with self._transport.session(self._as_signed(script), arguments_of(self._waits, abandoning=False)) as session:
            while (event := read_event(self.next_line(session))) is None or not is_ready(event):
                continue
            yield session

    def _end_session(self) -> None:
        self._session = None
        self._ends.close()

    def _script(self, application: str, shapes: Sequence[PartitionShape], works: Sequence[GuestWork]) -> ScriptBundle:
        """Make a script, and inspect it.

        Raises:
            HostFailed: the host cannot be observed, or the script must not run.
        """
        facts: HostFacts = self.observe().facts
        machines = [self._machine(shape) for shape in shapes]
        name = script_name(self._host)
        text = render_measuring(self._host, facts, application, machines, works)
        problems = inspect(text, ScriptKind.MEASURE, name)
        if has_errors(problems):
            raise HostFailed(self.name, f"{name} must not run: {problems[0].detail}", "report this")
        return ScriptBundle(runs=name, files={name: text.decode("ascii")})

    def _machine(self, shape: PartitionShape) -> TestMachine:
        image = self._settings.image or ""
        is_new = self._settings.generation == 2
        return TestMachine(
            name=shape.name,
            processors=shape.processors,
            memory=shape.memory,
            limit=shape.limit,
            weight=shape.weight,
            generation=self._settings.generation,
            image=image,
            folder=self._settings.vm_path or "",
            secure_boot=(self._settings.secure_boot or suggested_secure_boot(image)[0]) if is_new else "",
        )

    def _guest_works(
        self, partitions: Sequence[PartitionWork], shapes: Sequence[PartitionShape]
    ) -> tuple[GuestWork, ...]:
        """What runs inside guests, as the script is told it.

        Raises:
            HostRefused: something cannot run there.
        """
        works: list[GuestWork] = []
        for part in partitions:
            if not part.partition and (part.components or part.load):
                raise HostRefused(self.name, "what runs on the host itself cannot be measured", "give it a partition")
            credential = self._credentials.get(part.partition) or self._settings.credential or ""
            loads = () if part.load is None else (part.load,)
            for subject in (*part.components, *loads):
                if obstacle := self.obstacle(subject):
                    name = subject.name if isinstance(subject, Component) else "the load"
                    raise HostRefused(self.name, f"{name} cannot run inside a guest: {obstacle}", "see docs/hyperv.md")
            works += (self._component_work(part.partition, credential, component) for component in part.components)
            if part.load is not None:
                wide = next((shape.processors for shape in shapes if shape.name == part.partition), 1)
                works += load_works(part.partition, credential, part.load, wide)
        return tuple(works)

    def _component_work(self, partition: str, credential: str, component: Component) -> GuestWork:
        run = run_of(component)
        assert isinstance(run.start, Command), "an obstacle says so"
        folder = self._base / run.folder
        period = float(run.arrival.period) if isinstance(run.arrival, Periodic) else 0.0
        environment = {name: value for name, value in run.environment.items() if isinstance(value, str)}
        return GuestWork(
            partition=partition,
            credential=credential,
            name=component.name,
            kind="runs" if run.samples.source == "per_run" else "lines",
            words=run.start.words,
            environment={**environment, **({PERIOD_VARIABLE: f"{period:.12g}"} if period else {})},
            files={name: b64encode((folder / name).read_bytes()).decode("ascii") for name in sorted(run.files)},
            period_ticks=round(_TICKS * period),
            timeout_ms=round(float(run.timeout)),
        )


def load_works(partition: str, credential: str, load: Interference, processors: int) -> Iterator[GuestWork]:
    """Yield the programs that are a load inside a guest.

    Args:
        partition: in whose guest.
        credential: under which name the host keeps what that is entered with.
        load: as the manifest has it.
        processors: virtual ones, to keep busy where the load does not say how many.
    """

    def program(words: tuple[str, ...], instances: int = 1, files: Mapping[str, str] | None = None) -> GuestWork:
        return GuestWork(
            partition=partition,
            credential=credential,
            name="",
            kind="load",
            words=words,
            instances=instances,
            files=files,
        )

    match load:
        case BusyLoop(threads=threads):
            yield program(BUSY_LOOP, threads or processors)
        case CommandLoad(command=words, instances=instances):
            yield program(words, instances)
        case Browser(instances=instances):
            page = {"stream.html": b64encode((HERE / "stream.html").read_bytes()).decode("ascii")}
            for number in range(instances):
                yield program((EDGE, *FLAGS, f"--user-data-dir=profile-{number}", "stream.html"), files=page)
        case Stress():
            raise ValueError("an obstacle says that it cannot run there")
        case _:
            assert_never(load)


@dataclass(slots=True, kw_only=True)
class GuestRun:
    """A `RunningWork` inside guests; times are milliseconds of the host's clock since the setting began."""

    host: HypervMeasuringHost
    session: ScriptSession
    setting: str
    work: Work
    _now: float = 0.0
    _counts_from: float = 0.0
    _missing: dict[str, int] = field(default_factory=dict)
    _counters: list["_Counters"] = field(default_factory=list)  # the first one, and those since `count_from_now`

    def samples(self) -> Iterator[tuple[str, Sample]]:
        """See the interface."""
        times = [float(until.time) for until in self.work.until.values() if isinstance(until, Elapsed)]
        least = max(self.work.least_ms, *times, 0.0)
        readers = {
            component.name: _GuestReader(run_of(component))
            for part in self.work.partitions
            for component in part.components
        }
        self.count_from_now()
        while True:
            name, seen = self._next_seen()
            words = seen.split(" ")
            if words[0] == "counted":
                self._count(name, tuple(map(int, words[1:])))
            elif name in readers and (sample := readers[name].sample(seen, self._now)) is not None:
                if name in self._missing:
                    self._missing[name] -= 1
                yield name, sample
                if all(missing <= 0 for missing in self._missing.values()) and self._now >= self._counts_from + least:
                    return

    def _next_seen(self) -> tuple[str, str]:
        """Return the next line about this setting: a component or machine, and what was seen of it."""
        while True:
            seen = read_seen(self.host.next_line(self.session))
            if seen is not None and seen.setting == self.setting:
                self._now = max(self._now, float(seen.at_ms))
                return seen.name, seen.seen

    def _count(self, machine: str, ticks: tuple[int, ...]) -> None:
        if not self._counters or self._counters[-1].at_ms != self._now:
            del self._counters[3:-1]  # the first two, and the newest
            self._counters.append(_Counters(at_ms=self._now))
        self._counters[-1].ticks[machine] = ticks

    def count_from_now(self) -> None:
        """See the interface: from the newest counters on."""
        self._counts_from = self._now
        del self._counters[1:-1]
        self._missing = {
            name: until.samples if isinstance(until, SampleCount) else 1 for name, until in self.work.until.items()
        }

    def elapsed_ms(self) -> float:
        """See the interface."""
        return self._now

    def cpu_ms(self, component: str) -> float | None:
        """See the interface: of its machine, where it is alone there, drawn on from the last two counters."""
        alone = [
            part.partition
            for part in self.work.partitions
            if [member.name for member in part.components] == [component] and part.load is None
        ]
        counted = [counters for counters in self._counters if alone and alone[0] in counters.ticks]
        if len(counted) < 2:
            return None
        first, before, last = counted[0], counted[-2], counted[-1]
        ran = {at: counters.ticks[alone[0]][0] / _TICKS for at, counters in (("0", first), ("1", before), ("2", last))}
        rate = (ran["2"] - ran["1"]) / max(1.0, last.at_ms - before.at_ms)
        return ran["2"] - ran["0"] + rate * (self._now - last.at_ms)

    def evidence(self) -> SettingEvidence | None:
        """See the interface: what the hypervisor counted of each machine (FACTS 8)."""
        if len(self._counters) < 2:
            return None
        before, last = self._counters[-2 if len(self._counters) == 2 else 1], self._counters[-1]
        names = sorted(before.ticks.keys() & last.ticks.keys() & {part.partition for part in self.work.partitions})
        gone = {
            name: [new - old for new, old in zip(last.ticks[name], before.ticks[name], strict=True)] for name in names
        }
        return SettingEvidence(
            elapsed_ms=last.at_ms - before.at_ms,
            cpu_ms={name: ran / _TICKS for name, (ran, _, _) in gone.items()},
            dispatch_wait_ns={
                name: waited / dispatches for name, (_, waited, dispatches) in gone.items() if dispatches
            },
        )


@dataclass(slots=True, kw_only=True)
class _Counters:
    """What the hypervisor had counted at a time, by machine: ran, waited (100 ns), dispatches."""

    at_ms: float
    ticks: dict[str, tuple[int, ...]] = field(default_factory=dict)


@dataclass(frozen=True, slots=True, kw_only=True)
class Seen:
    """A line of a measuring script about what it saw."""

    setting: str
    name: str
    seen: str
    at_ms: int


def read_seen(line: str) -> Seen | None:
    """Read a line of a measuring script.

    Args:
        line: of its output.

    Returns:
        None where it is an event, or noise of the host.
    """
    if not line.startswith("{"):
        return None
    try:
        document = parse_json(line)
    except NotDecodable:
        return None
    match document:
        case {"format": str(kind), "setting": str(setting), "name": str(name), "seen": str(seen), "at_ms": int(at_ms)}:
            return Seen(setting=setting, name=name, seen=seen, at_ms=at_ms) if kind == FORMAT else None
        case _:
            return None


class _GuestReader:
    """Makes samples of what the runner inside a guest says of one component."""

    def __init__(self, run: Run) -> None:
        self._run = run
        self._read = answer_reader(run)
        self._offset: float | None = None  # of the guest's clock, on the host's, in ms
        self._last = 0.0  # ms of the guest's clock: when the process began, or its last sample came
        self._samples = 0  # of this process

    def sample(self, seen: str, now: float) -> Sample | None:
        """Return the sample that a line is, if any.

        Args:
            seen: what the runner said.
            now: of the host's clock, in ms.
        """
        kind, _, rest = seen.partition(" ")
        first, _, text = rest.partition(" ")
        at = int(first) / _TICKS
        if self._offset is None:
            self._offset = now - at
        match kind:
            case "started":
                self._last, self._samples = at, 0
                return None
            case "line":
                return self._of_answer(self._read(text), at)
            case "late":
                shown = show_milliseconds(self._run.timeout)
                is_process = self._run.samples.source == "per_run"
                return self._failed(
                    at if is_process else self._last, f"no {'exit' if is_process else 'sample'} within {shown}"
                )
            case _:
                return self._of_end(at, *map(int, text.split(" ")))

    def _of_end(self, due: float, ended_ticks: int, code: int) -> Sample | None:
        if self._run.samples.source == "per_run":
            return self._answered(due, ended_ticks / _TICKS - due, successful=code == 0)
        if code == 0 and self._samples:
            return None
        return self._failed(self._last, f"it ended with exit code {code}")

    def _of_answer(self, answer: JobAnswer | Unreadable | None, at: float) -> Sample | None:
        if answer is None:
            return None
        began, self._last = self._last, at
        if isinstance(answer, Unreadable):
            return self._failed(began, answer.message)
        self._samples += 1
        reading = answer.reading
        return self._answered(
            at - (reading.response_ms or 0.0),
            reading.response_ms,
            successful=reading.successful,
            count=reading.count,
        )

    def _answered(self, began: float, response_ms: float | None, *, successful: bool, count: float = 1.0) -> Sample:
        return Sample(began_ms=self._on_host(began), response_ms=response_ms, successful=successful, count=count)

    def _failed(self, began: float, message: str) -> Sample:
        return Sample(began_ms=self._on_host(began), response_ms=None, successful=False, failure=message)

    def _on_host(self, at: float) -> float:
        return max(0.0, at + (self._offset or 0.0))
