"""Measuring on a Hyper-V host: one script makes P1 and P2, runs components and loads inside guests, and removes all.

rarms sends it the next setting (`3 run 45 55.`) and hears lines: what guests said, and what the hypervisor counted. A
guest's lines carry the times of its own clock, in which durations are; where they lie on the host's is known to 0.1 s.
"""

import sys
from base64 import b64encode
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import AbstractContextManager, ExitStack, contextmanager, nullcontext
from pathlib import Path
from typing import assert_never

from rarms_iac.model.commands import command, prose
from rarms_iac.model.host import Host
from rarms_iac.model.loads import Browser, Bursts, BusyLoop, CommandLoad, Interference, Stress
from rarms_iac.model.run import Call, Command, FromEnvironment, Periodic, Run
from rarms_iac.model.setting import PartitionShape, PlatformFacts
from rarms_iac.model.state import HostFacts
from rarms_iac.model.system import Component, run_of
from rarms_iac.powershell.measuring import GuestWork, render_measuring, script_name
from rarms_iac.providers.channel import Conversation, SilenceTimeout, no_look
from rarms_iac.providers.hyperv.guest_samples import TICKS_MS, GuestRun
from rarms_iac.providers.hyperv.provider import LiveHypervHost, read_event
from rarms_iac.providers.hyperv.transport import FAILED, STOP, Transport, arguments_of, end_of
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
from rarms_iac.providers.measuring import NO_RUN, Obstacle, PartitionWork, Work
from rarms_iac.running.environment import PERIOD_VARIABLE
from rarms_iac.running.loads import FLAGS, HERE
from rarms_iac.storage.reading import read_file
from rarms_iac.texts.messages import last_words, reason_of

MEMORY_MS = 100.0
"""How long the past influences the hypervisor's scheduling. Not documented; taken as the simulated host has it."""

SILENCE_S = 120.0
"""A script that measures writes a line every second; one that waits for guests, every three seconds."""

LARGEST_FILES = 4 * 2**20
"""Bytes of a component's files that travel inside the script."""

EDGE = "C:\\Program Files (x86)\\Microsoft\\Edge\\Application\\msedge.exe"
"""The browser that every Windows has."""

BUSY_LOOP = ("powershell.exe", "-NoProfile", "-Command", "while ($true) { }")
POWERSHELL_FILE = ("powershell.exe", "-NoProfile", "-ExecutionPolicy", "Bypass", "-File")


class HypervMeasuringHost(LiveHypervHost):
    """A `ScriptedMeasuringHost`."""

    def __init__(
        self, host: Host, transport: Transport, signed: Path | None, base: Path, credentials: Mapping[str, str]
    ) -> None:
        """Prepare; nothing is read before the first call.

        Args:
            base: the manifest's folder, where the files of components lie.
            credentials: by partition, under which name the host keeps what its guest is entered with.
        """
        super().__init__(host, transport, signed)
        self._base = base
        self._credentials = credentials
        self._settings = host.hyperv
        self._shapes: tuple[PartitionShape, ...] = ()
        self._reserves: Mapping[str, int] = {}
        self._waits = NO_WAITING
        self._ends = ExitStack()  # the session that measures now
        self._session: Conversation | None = None
        self._runs: tuple[GuestWork, ...] = ()  # what that session was started with
        self._number = 0  # of the setting

    def platform_facts(self) -> PlatformFacts:
        facts = self.observe().facts
        return PlatformFacts(
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
        return MEMORY_MS

    @contextmanager
    def lock(self, owner: str, timeout_ms: int = 0) -> Iterator[None]:  # noqa: ARG002 - a script names its own
        """Note how long to wait: the script that measures holds the host while there are test partitions."""
        self._waits = WaitLimits(lock_ms=timeout_ms)
        yield

    def obstacle(self, subject: Component | Interference, *, in_its_partition: bool = False) -> Obstacle | None:
        if in_its_partition:
            return self._obstacle_in_guest(subject)
        if not self._settings.image:
            return Obstacle("its test partitions have no disk", "Set an image of Windows: `hyperv: { image: ... }`.")
        if isinstance(subject, Component) and subject.task_class is not None:
            return Obstacle(
                f"its guest reads the class {subject.task_class} only after a restart; rarms does not restart it",
                prose(
                    "Set its `cpu: { reserve: ... }` in the manifest: ",
                    command("prove"),
                    " runs it in its own partition.",
                ),
            )
        return self._obstacle_in_guest(subject)

    def _obstacle_in_guest(self, subject: Component | Interference) -> Obstacle | None:
        """Say why it cannot run in a guest that has its task class."""
        if isinstance(subject, Stress):
            return Obstacle("stress-ng does not run on Windows", "Use another load as its `interference`.")
        if not isinstance(subject, Component):
            return None
        return NO_RUN if subject.run is None else self._obstacle_of_run(subject.run)

    def _obstacle_of_run(self, run: Run) -> Obstacle | None:
        if isinstance(run.start, Call):
            return Obstacle("guests run commands, not Python functions", "Write a `command` that calls it.")
        if not isinstance(run.start, Command):
            return Obstacle("guests run commands only", "Write a `command` that starts it.")
        if run.user or run.groups or run.setup or run.environment_file:
            return Obstacle(
                "users, setup files and files of variables are for Linux only", "Remove them from its `run`."
            )
        if run.samples.file or run.samples.socket:
            return Obstacle("rarms reads only the standard output of a guest", "Write samples to standard output.")
        if run.samples.source == "ros":
            return Obstacle("guests do not have ROS", "Measure it on a Linux host.")
        if run.samples.stream == "stderr":
            return Obstacle("rarms reads only the standard output of a guest", "Write samples to standard output.")
        if taken := [name for name, value in run.environment.items() if isinstance(value, FromEnvironment)]:
            return Obstacle(
                f"{taken[0]} is a variable of rarms, and its value would be in a script",
                "Set it in the image's Windows.",
            )
        try:
            size = sum((self._base / run.folder / name).stat().st_size for name in run.files)
        except OSError as problem:
            return Obstacle(f"a file of its `run` cannot be read: {reason_of(problem)}", "Correct `run.files`.")
        if size <= LARGEST_FILES:
            return None
        return Obstacle(
            f"its files have {size} bytes; a script can contain at most {LARGEST_FILES}",
            "Put them into the image of the guest.",
        )

    @contextmanager
    def test_partitions(self, shapes: Sequence[PartitionShape]) -> Iterator[None]:
        self._shapes = tuple(shapes)
        try:
            yield
            if self._session is not None:
                self._session.send(STOP)
                self._wait_until(self._session, lambda event: event.status is EventStatus.DONE)
        finally:
            self._shapes = ()
            self._end_session()

    def set_reserves(self, reserves: Mapping[str, int]) -> None:
        self._reserves = dict(reserves)

    def remove_test_partitions(self) -> None:
        with self._started(self._script(self.name, (), ()), lambda event: event.status is EventStatus.DONE):
            pass

    def measuring_script(
        self, application: str, shapes: Sequence[PartitionShape], partitions: Sequence[PartitionWork]
    ) -> str:
        script = self._script(application, shapes, self._guest_works(partitions, shapes))
        return script.files[script.runs]

    @contextmanager
    def run(self, work: Work) -> Iterator["GuestRun"]:
        works = self._guest_works(work.partitions, self._shapes)
        if self._session is None or works != self._runs:
            self._end_session()
            script = self._script(work.application, self._shapes, works)
            ready = self._started(script, lambda event: event.detail == "ready")
            self._session, self._runs = self._ends.enter_context(ready), works
        self._number += 1
        reserves = " ".join(str(self._reserves.get(shape.name, 0)) for shape in self._shapes)
        setting = f"{self._number} run {reserves}".rstrip() + "."
        self._session.send(setting.encode("ascii"))
        try:
            session = self._session
            yield GuestRun(next_line=lambda: self._next_line(session), setting=setting, work=work)
        except BaseException:
            self._end_session()
            raise
        if self._shapes:
            self._number += 1
            self._session.send(f"{self._number} rest.".encode("ascii"))
        else:
            self._end_session()

    def _next_line(self, session: Conversation, silence_s: float = SILENCE_S) -> str:
        """Return the next line of a script that is to go on.

        Args:
            silence_s: how many seconds it may say nothing.

        Returns:
            Any line of its output.

        Raises:
            HostRefused: the script refused to go on.
            HostFailed: it failed, ended, or says nothing any more.
        """
        try:
            line = session.next_line(silence_s, no_look)
        except SilenceTimeout:
            raise self._broken(f"no output of the script for {silence_s:.0f} s") from None
        if line is None:
            match end_of(session):
                case ScriptExited(code=code, last_lines=lines):
                    raise self._broken(f"the script ended: {last_words(' '.join(lines[-2:]), code)}")
                case lost:
                    raise self._broken(f"the script was lost: {lost.why}")
        if line.startswith(FAILED):
            raise self._broken(f"the receiver of the script failed: {line.removeprefix(FAILED).strip(' .')}")
        event = read_event(line)
        if event is not None and event.status is EventStatus.REFUSED:
            raise HostRefused(
                self.name, event.reason, "Correct the cause, then run the same command again. Results so far are saved."
            )
        if event is not None and event.kind is EventKind.FAILED:
            raise self._broken(event.reason)
        return line

    def _broken(self, message: str) -> HostFailed:
        return HostFailed(
            self.name,
            message,
            "Run the same command again. Results so far are saved, and rarms removes the test partitions on the host.",
        )

    @contextmanager
    def _started(self, script: ScriptBundle, is_ready: Callable[[RunEvent], bool]) -> Iterator[Conversation]:
        """Run a script, from when it says a certain thing."""
        arguments = arguments_of(self._waits, abandoning=False)
        with self._credential_files(), self._transport.session(self._as_signed(script), arguments) as session:
            self._wait_until(session, is_ready, SILENCE_S + self._waits.lock_ms / 1000)
            yield session

    def _wait_until(
        self, session: Conversation, is_so: Callable[[RunEvent], bool], silence_s: float = SILENCE_S
    ) -> None:
        while (event := read_event(self._next_line(session, silence_s))) is None or not is_so(event):
            continue

    def _credential_files(self) -> AbstractContextManager[None]:
        """Have the host keep what Credential Manager of this computer keeps, where this is the host."""
        if sys.platform == "win32" and self._host.connect is None:
            from rarms_iac.providers.hyperv.local_windows import credential_files

            return credential_files(filter(None, (self._settings.credential, *self._credentials.values())))
        return nullcontext()

    def _end_session(self) -> None:
        self._session = None
        self._ends.close()

    def _script(self, application: str, shapes: Sequence[PartitionShape], works: Sequence[GuestWork]) -> ScriptBundle:
        """Make a script.

        Raises:
            HostFailed: the host cannot be observed.
        """
        facts: HostFacts = self.observe().facts
        name = script_name(self._host)
        text = render_measuring(self._host, facts, application, shapes, works)
        return ScriptBundle(runs=name, files={name: text.decode("ascii")})

    def _guest_works(
        self, partitions: Sequence[PartitionWork], shapes: Sequence[PartitionShape]
    ) -> tuple[GuestWork, ...]:
        """Return the work inside guests, in the script's form.

        Raises:
            HostRefused: something cannot run there.
        """
        works: list[GuestWork] = []
        for part in partitions:
            if not part.partition and (part.components or part.load):
                raise HostRefused(
                    self.name, "rarms cannot measure a component on the host itself", "Move it into a partition."
                )
            credential = self._credentials.get(part.partition) or self._settings.credential or ""
            loads = () if part.load is None else (part.load,)
            is_test_partition = part.partition in {shape.name for shape in shapes}
            for subject in (*part.components, *loads):
                if obstacle := self.obstacle(subject, in_its_partition=not is_test_partition):
                    name = subject.name if isinstance(subject, Component) else "the load"
                    raise HostRefused(self.name, f"{name} cannot run: {obstacle.reason}", obstacle.advice)
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
        is_lines = run.samples.source != "per_run"
        return GuestWork(
            partition=partition,
            credential=credential,
            name=component.name,
            kind="lines" if is_lines else "runs",
            words=run.start.words,
            environment={**environment, **({PERIOD_VARIABLE: f"{period:.12g}"} if period else {})},
            files={name: _base64(folder / name) for name in sorted(run.files)},
            period_ticks=0 if is_lines else round(TICKS_MS * period),
            timeout_ms=round(float(run.timeout)),
        )


def load_works(partition: str, credential: str, load: Interference, processors: int) -> Iterator[GuestWork]:
    """Yield the programs that are a load inside a guest.

    Args:
        credential: under which name the host keeps what that is entered with.
        processors: virtual ones, to keep busy where the load does not say how many.
    """

    def program(
        words: tuple[str, ...], instances: int = 1, files: Mapping[str, str] | None = None, kind: str = "load"
    ) -> GuestWork:
        return GuestWork(
            partition=partition,
            credential=credential,
            name="",
            kind=kind,
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
            page = {"stream.html": _base64(HERE / "stream.html")}
            for number in range(instances):
                yield program((EDGE, *FLAGS, f"--user-data-dir=profile-{number}", "stream.html"), files=page)
        case Bursts(every=every, duty=duty, threads=threads):
            numbers = (str(threads or processors), str(round(1000 * every)), str(round(10 * duty) if duty else 0))
            words = (*POWERSHELL_FILE, "bursts.ps1", *numbers)
            yield program(words, files={"bursts.ps1": _base64(HERE / "bursts.ps1")}, kind="calibrated")
        case Stress():
            raise ValueError("an obstacle says that it cannot run there")
        case _:
            assert_never(load)


def _base64(path: Path) -> str:
    return b64encode(read_file(path, LARGEST_FILES)).decode("ascii")
