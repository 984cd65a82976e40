"""Makes samples of ROS messages: the time from an input to the output that carries its stamp.

A subscriber runs next to the component, outside of its partition (`message_subscriber.py`, a program of its own), and
sends when messages came; `message_pairs.py` pairs them. Begin at `samples_of_messages`.
"""

import json
import os
import shutil
import subprocess
import time
from collections.abc import Generator, Mapping
from fractions import Fraction
from pathlib import Path
from statistics import median, quantiles
from typing import Any

from rarms_iac.model.quantities import Milliseconds
from rarms_iac.model.run import Command, Process, Run, Service, Stop
from rarms_iac.model.series import HeardMessages, Sample
from rarms_iac.running.environment import as_user, own_program
from rarms_iac.running.events import OutputLine, ProcessEnded, describe_early_end, named_end
from rarms_iac.running.message_pairs import MessageJob, MessagePairs
from rarms_iac.running.orders import CannotStart, ProcessOrder, StartOrder
from rarms_iac.running.samples import SampleRecord, SampleSource, SamplingEnd
from rarms_iac.running.supervisor import Supervisor
from rarms_iac.texts.messages import counted, in_a_row
from rarms_iac.texts.quantities import show_milliseconds

SUBSCRIBER = Path(__file__).resolve().with_name("message_subscriber.py")
START_S = 60.0
"""The least time in which a component's first output must come: nodes load models, and find each other."""
MASTER_S = 10.0
"""How long the master of ROS 1 is waited for before the component starts."""
WAITING_S = 5.0
"""How long the first sample is waited for before the user hears why none comes."""
LOOK_S = 0.05
"""How often the component's own process is looked at."""
SLACK_S = 0.25
"""How much later than its time-out an input is given up: the line of its output may be on its way."""
LATEST = 1000
"""Measurements of the subscriber's delay, and of the clock, that are kept."""
LEAVES_MASTER = Stop(signal="TERM", grace=Milliseconds(Fraction(2000)))
"""How the subscriber is stopped: it unregisters, unless its master does not answer."""
NO_ROS = "Install python3-rospy (ROS 1) or python3-rclpy (ROS 2), or add the setup file of ROS to `run.setup`."
NO_MASTER = "Start it with your drivers, or name the right one: `ROS_MASTER_URI` in `run.environment`."
_SEARCHING_S = 30.0
_SEARCH = "import importlib.util as u; print(*(name for name in ('rclpy', 'rospy') if u.find_spec(name)))"


def subscriber_order(component: str, run: Run, order: StartOrder) -> StartOrder | None:
    """Return the order to start the subscriber; None: the samples do not come from messages.

    Args:
        order: The component's own, whose environment and user the subscriber has.

    Raises:
        CannotStart: No Python on the PATH of the component's environment has rospy or rclpy.
    """
    if run.samples.source != "ros":
        return None
    process = run.each_process[run.samples.process]
    sampled = next(each for each in order.processes if each.name == run.samples.process)
    before, environment = _before_subscriber(component, process, sampled)
    python, version = _find_ros(component, before, environment)
    words = (*before, python, str(SUBSCRIBER), version, run.samples.input, run.samples.output)
    program = shutil.which(words[0]) or words[0]
    own = ProcessOrder(name="", words=(program, *words[1:]), folder=sampled.folder, environment=environment)
    return StartOrder(name=component, processes=(own,), stop=LEAVES_MASTER, keeps_priority=True)


def _before_subscriber(
    component: str, process: Process, order: ProcessOrder
) -> tuple[tuple[str, ...], Mapping[str, str]]:
    """Return the words that make the subscriber its component's user, without a priority, and its variables."""
    if isinstance(process.start, Command):
        prefix, own = order.words[: len(order.words) - len(process.start.words)], map(own_program, ("setpriv", "env"))
        begin = min((prefix.index(word) for word in own if word in prefix), default=len(prefix))
        return prefix[begin:], order.environment
    environment = {**order.environment, **(order.variables.values if order.variables else {})}
    if isinstance(process.start, Service):
        return as_user(component, process, environment)
    return (), environment


def _find_ros(component: str, before: tuple[str, ...], environment: Mapping[str, str]) -> tuple[str, str]:
    path = environment.get("PATH", os.defpath)
    wanted = {"1": "rospy", "2": "rclpy"}.get(environment.get("ROS_VERSION", ""), "")
    for folder in dict.fromkeys((*path.split(os.pathsep), "/usr/bin")):
        if (python := shutil.which("python3", path=folder)) is None:
            continue
        try:
            asked = subprocess.run(
                [*before, python, "-c", _SEARCH],
                check=False,
                env=dict(environment),
                capture_output=True,
                text=True,
                timeout=_SEARCHING_S,
            )
        except subprocess.TimeoutExpired:
            continue
        modules = [name for name in asked.stdout.split() if wanted in {"", name}]
        if modules:
            return python, "2" if modules[0] == "rclpy" else "1"
    raise CannotStart(
        component, f"its `samples` need {wanted or 'rospy or rclpy'}, which is not installed for any python3", NO_ROS
    )


def samples_of_messages(order: StartOrder) -> SampleSource:
    """Make a sample of each input, and one for each death of the component and for messages that do not come.

    Args:
        order: That of the subscriber.
    """

    def samples(supervisor: Supervisor, record: SampleRecord) -> Generator[Sample, None, None]:
        subscriber = Supervisor(order)
        try:
            yield from _MessageReader(supervisor, subscriber, record).samples()
        finally:
            subscriber.close()

    return samples


class _MessageReader:
    def __init__(self, supervisor: Supervisor, subscriber: Supervisor, record: SampleRecord) -> None:
        self._supervisor = supervisor
        self._subscriber = subscriber
        self._record = record
        self._pairs = MessagePairs(timeout_s=record.timeout)
        self._delays: list[float] = []
        self._ahead: list[float] = []
        self._simulated = False
        self._unpublished: tuple[str, ...] = ()
        self._said = ""  # last, of what is waited for
        self._no_master = ""
        self._silent_since = time.perf_counter()  # when the last input came, or before the first output the start
        self._is_stopping = False

    def samples(self) -> Generator[Sample, None, None]:
        record = self._record
        record.heard = self._heard
        self._supervisor.ignore_output()
        self._subscriber.start()
        self._wait_for_master()
        self._silent_since = time.perf_counter()
        self._supervisor.start()
        while record.ending is SamplingEnd.RUNNING:
            for sample, at in self._next():
                if record.is_over(at):
                    return
                yield record.take(sample, at)
                if record.ending is not SamplingEnd.RUNNING:
                    return
            if record.is_over(time.perf_counter()):
                return

    def _wait_for_master(self) -> None:
        """Return when the subscriber hears of a master: without one, a node of ROS 1 ends with a traceback."""
        began = time.perf_counter()
        while not self._listen() or self._no_master:
            waited = time.perf_counter() - began
            if self._no_master and waited >= MASTER_S:
                reason = f"the ROS master at {self._no_master} does not answer"
                raise CannotStart(self._supervisor.name, reason, NO_MASTER)
            if waited >= START_S:
                return

    def _listen(self) -> bool:
        """Wait a moment for the subscriber, and return whether it said something."""
        event = self._subscriber.next(time.perf_counter() + LOOK_S)
        if isinstance(event, OutputLine):
            self._take(event)
        if isinstance(event, ProcessEnded):
            lines = self._subscriber.settled_tail().strip().splitlines() or [describe_early_end(event)]
            raise CannotStart(self._supervisor.name, f"its message subscriber ended: {lines[-1]}", NO_ROS)
        return isinstance(event, OutputLine)

    def _next(self) -> list[tuple[Sample, float]]:
        """Wait a moment, and return the samples that it brought, with their ends."""
        self._listen()
        now = time.perf_counter()
        jobs = [self._of_job(job) for job in self._pairs.jobs(now - SLACK_S)]
        if not self._pairs.has_begun and now >= self._silent_since + WAITING_S:
            self._say(self._what_is_missing())
        return [*jobs, *self._of_process(now)]

    def _say(self, missing: str) -> None:
        if missing != self._said:
            self._said = missing
            self._record.waits(missing)

    def _take(self, line: OutputLine) -> None:
        message: Mapping[str, Any] = json.loads(line.text)
        match message:
            case {"topic": "input", "stamp": int(stamp), "at": float(at), "ahead_ms": float(ahead_ms)}:
                self._ahead = [*self._ahead[-LATEST:], ahead_ms]
                if self._pairs.has_begun:
                    self._silent_since = at
                if not self._is_stopping:
                    self._pairs.take_input(stamp, at)
            case {"topic": "output", "stamp": int(stamp), "at": float(at)}:
                if not self._is_stopping:
                    self._pairs.take_output(stamp, at)
            case {"delay_ms": float(delay_ms)}:
                self._delays = [*self._delays[-LATEST:], delay_ms]
            case {"simulated": bool(simulated)}:
                self._simulated, self._no_master = simulated, ""
            case {"no_master": str(uri)}:
                self._no_master = uri
            case {"unpublished": [*topics]}:
                self._unpublished, self._no_master = tuple(map(str, topics)), ""
            case {"cannot": str(reason)}:
                raise CannotStart(self._supervisor.name, reason, "Name topics whose messages begin with a `header`.")
            case _:
                raise CannotStart(self._supervisor.name, f"its message subscriber failed: {line.text[:200]}")

    def _of_job(self, job: MessageJob) -> tuple[Sample, float]:
        self._record.begin(job.began)
        response_ms = None if job.ended is None else 1000 * (job.ended - job.began)
        sample = self._record.answered(job.began, response_ms, successful=response_ms is not None)
        return sample, job.began + self._record.timeout if job.ended is None else job.ended

    def _of_process(self, now: float) -> list[tuple[Sample, float]]:
        """Return a failed sample where the component's process ended, or its messages do not come."""
        event = self._supervisor.next(now)
        if isinstance(event, ProcessEnded):
            was_stopped, self._is_stopping = self._is_stopping, False
            began, self._silent_since = self._silent_since, now
            self._pairs.restart()
            self._supervisor.start()
            ended = named_end(event, self._record.run.samples.process)
            reason = describe_early_end(ended) if ended.signal or ended.code or ended.process else "it ended"
            return [] if was_stopped else [(self._record.failure(began, reason), now)]
        patience = max(START_S, self._record.timeout)
        if self._is_stopping or now < self._silent_since + patience:
            return []
        self._is_stopping = True
        self._supervisor.stop()
        return [(self._record.failure(self._silent_since, self._why_silent(patience)), now)]

    def _what_is_missing(self) -> str:
        """Say which messages do not come, without numbers that change."""
        samples, pairs = self._record.run.samples, self._pairs
        if unpublished := self._without_publisher():
            return unpublished
        for topic, number in ((samples.input, pairs.inputs), (samples.output, pairs.outputs)):
            if not number:
                return f"{topic} has a publisher, but no message came"
        if unstamped := self._unstamped():
            return f"the messages of {in_a_row(list(unstamped))} have the stamp 0{self._advice_for(unstamped)}"
        timeout = show_milliseconds(self._record.run.timeout)
        return f"no message of {samples.output} has the stamp of a message of {samples.input} of the last {timeout}"

    def _without_publisher(self) -> str:
        """Say which topics without a message have no publisher; empty: none."""
        samples, pairs = self._record.run.samples, self._pairs
        numbers = {samples.input: pairs.inputs, samples.output: pairs.outputs}
        topics = [topic for topic in self._unpublished if not numbers.get(topic)]
        return f"{in_a_row(topics)} {'has' if len(topics) == 1 else 'have'} no publisher" if topics else ""

    def _unstamped(self) -> Mapping[str, str]:
        """Return the topics with the stamp 0 in most messages, each with the number of these messages."""
        samples, pairs = self._record.run.samples, self._pairs
        counts = {
            samples.input: (pairs.unstamped_inputs, pairs.inputs),
            samples.output: (pairs.unstamped_outputs, pairs.outputs),
        }
        return {
            topic: f"{unstamped} of {counted(number, 'message')} of {topic}"
            for topic, (unstamped, number) in counts.items()
            if 2 * unstamped > number
        }

    def _advice_for(self, unstamped: Mapping[str, str]) -> str:
        """Say what to do about the stamp 0. An output copies it from an input that has it."""
        samples = self._record.run.samples
        if samples.input in unstamped:
            return f"; the publisher of {samples.input} must set `header.stamp`"
        return f"; copy `msg.header.stamp` of {samples.input} into the message of {samples.output}"

    def _why_silent(self, patience: float) -> str:
        """Say what came instead of the output to an input."""
        samples, pairs = self._record.run.samples, self._pairs
        within = f"within {patience:g} s"
        inputs = f"{counted(pairs.inputs, 'message')} of {samples.input}"
        outputs = f"{counted(pairs.outputs, 'message')} of {samples.output}"
        why = f"; {unpublished}" if (unpublished := self._without_publisher()) else ""
        if not pairs.inputs or pairs.has_begun:
            return f"no message of {samples.input} came {within}{why}"
        if not pairs.outputs:
            return f"no message of {samples.output} came {within}, but {inputs}{why}"
        if unstamped := self._unstamped():
            return f"{in_a_row(list(unstamped.values()))} have the stamp 0{self._advice_for(unstamped)}"
        timeout = show_milliseconds(self._record.run.timeout)
        return f"none of {outputs} came within {timeout} after the {inputs} with the same stamp"

    def _heard(self) -> HeardMessages:
        pairs, delays = self._pairs, self._delays
        return HeardMessages(
            input=self._record.run.samples.input,
            inputs=pairs.inputs,
            outputs=pairs.outputs,
            unmatched=pairs.unmatched,
            delay_ms=median(delays) if delays else None,
            p99_delay_ms=quantiles(delays, n=100)[-1] if len(delays) > 1 else None,
            ahead_ms=median(self._ahead) if self._ahead else 0.0,
            simulated_time=self._simulated,
        )
