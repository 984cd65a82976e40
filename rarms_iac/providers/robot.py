"""A Linux host with a rarms of its own: this side sends requests to it over a channel, and receives the answers.

In: a command with its job, as JSON. Out: calls of reporters, then the answer of the rarms on the host. Begin at
`RobotByChannel`; `rarms_iac.robot` is the other side. One request is one line on standard input. The answer is lines
on standard output: `READY`, then calls, and last a result or a failure. A line has at most `LINE_LIMIT` bytes.
"""

import json
import threading
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass, replace
from typing import Any, Literal, cast, get_type_hints

from rarms_iac.model.commands import Prose, command, prose
from rarms_iac.model.diagnostics import Diagnostic
from rarms_iac.model.host import Host
from rarms_iac.model.journal import Journal
from rarms_iac.model.seen_host import SeenHost
from rarms_iac.model.state import State
from rarms_iac.model.version import __version__
from rarms_iac.providers.channel import (
    LOOK_AT_OUTPUT,
    SSH_FAILED,
    CommandChannel,
    Conversation,
    EndedConversation,
    LiveChannel,
    SilenceTimeout,
    await_line,
    last_of,
    look_for_stop,
)
from rarms_iac.providers.interface import (
    UNHEARD,
    HostDamaged,
    HostError,
    HostFailed,
    HostRefused,
    HostUnreachable,
    RobotListener,
)
from rarms_iac.storage.codec import Json, NotDecodable, decode, decode_union, encode
from rarms_iac.storage.json_text import parse_json
from rarms_iac.storage.writing import owner

LINE_LIMIT = 64 * 2**20
"""Bytes of a request, and of each line of an answer."""

INSTALLED = "/opt/rarms"
"""The folder on a robot that has a virtual environment for each installed version."""

READY = "rarms: ready"
VERSIONS = "rarms: installed"
STOP, YES, NO, ALL_SENT, HERE = "stop", "yes", "no", "all sent", "here"
"""Lines behind a request. `STOP` asks for an end after the running step. `ALL_SENT` says that no line follows, so that
the end of the input does not mean that the connection broke. `HERE` comes every `HERE_S` seconds."""

HERE_S = 15.0
LOST_S = 60.0
"""Seconds without a line after which the robot takes the connection for broken: a cut cable ends no input."""

SILENCE_S = 24 * 3600.0
"""Seconds without a line after which a command is given up: one setting may take hours."""

_MISSING = 69  # exit code of the entry command where this version is not installed


def entry_command(version: str = __version__) -> str:
    """Return the command for a channel: rarms of this version as root, or a list of the versions that are there.

    No text of a manifest is in it.

    Args:
        version: the one that is called.
    """
    place = f"{INSTALLED}/{version}"
    return (
        f"""sh -c 'run="/usr/bin/env -i {place}/bin/python -I -m rarms_iac.robot"; """
        f"""if [ ! -d {place} ]; then echo "{VERSIONS}" $(ls {INSTALLED} 2>/dev/null); exit {_MISSING}; """
        """elif [ "$(id -u)" = 0 ]; then exec $run; else exec sudo -n $run; fi'"""
    )


Ask = Callable[[], bool]


@dataclass(frozen=True, slots=True, kw_only=True)
class HostProblem:
    """A `HostError` as it travels."""

    name: str  # of its class
    message: str
    advice: Prose

    def on(self, host: str) -> HostError:
        """Return the error again, for a host of this name."""
        return _PROBLEMS.get(self.name, HostFailed)(host, self.message, self.advice)


_PROBLEMS = {error.__name__: error for error in (HostDamaged, HostFailed, HostRefused, HostUnreachable)}


def problem_of(error: HostError) -> HostProblem:
    """Return an error as it travels; a class that does not becomes `HostFailed`."""
    return HostProblem(name=type(error).__name__, message=error.message, advice=prose(error.advice))


@dataclass(frozen=True, slots=True, kw_only=True)
class Look:
    """The result of one look at a host, with a problem in place of a part that could not be read."""

    observed: SeenHost | HostProblem
    last_run: Journal | HostProblem | None
    holder: str


@dataclass(frozen=True, slots=True, kw_only=True)
class Request:
    """The line of a request."""

    version: str
    command: str
    by: str  # who asks, as of `storage.writing.owner`
    host: Host  # as the manifest describes it, without `connect`
    listens: bool  # this side hears calls as they are made, and answers questions
    job: Any  # JSON: what the command needs


@dataclass(frozen=True, slots=True, kw_only=True)
class ReporterCall:
    """A call of a method of a reporter on this side."""

    kind: Literal["call"] = "call"
    target: str
    method: str
    arguments: Any  # JSON


@dataclass(frozen=True, slots=True, kw_only=True)
class Result:
    """The last line of a command that was done."""

    kind: Literal["result"] = "result"
    value: Any  # JSON


@dataclass(frozen=True, slots=True, kw_only=True)
class Failure:
    """The last line of a command that ended without a result."""

    kind: Literal["failure"] = "failure"
    outcome: Literal["failed", "refused", "negative", "missing", "interrupted"]  # the value of an `Outcome`
    findings: tuple[Diagnostic, ...]  # empty: this side asked for the end


Answer = ReporterCall | Result | Failure


class EndedThere(HostError):
    """The robot's rarms ended without a result, for reasons that its findings have."""

    def __init__(self, host: str, failure: Failure) -> None:
        reasons = [f"{each.summary} ({each.code})" for each in failure.findings]
        super().__init__(host, "; ".join(reasons) or "it stopped on request", "")
        self.outcome = failure.outcome
        self.findings = failure.findings


class OtherVersion(HostFailed):
    """The robot has other versions of rarms, or none."""

    def __init__(self, host: str, installed: tuple[str, ...]) -> None:
        there = f"it has rarms {', '.join(installed)}" if installed else "rarms is not installed there"
        advice = prose("Install this version there: ", command("install", host=host), ".")
        super().__init__(host, f"{there}; this is rarms {__version__}", advice)
        self.installed = installed


class RobotByChannel:
    """A `RobotHost`. One look answers each kind of question once; a second question of a kind looks again."""

    def __init__(self, host: Host, channel: CommandChannel) -> None:
        """Prepare; nothing is sent before the first call."""
        self._host = host
        self._channel = channel
        self._look: Look | None = None
        self._answered: set[str] = set()
        self._looks_once = False

    @property
    def name(self) -> str:
        return self._host.name

    def look_once(self) -> None:
        self._looks_once = True

    def examined(self, application: str) -> SeenHost:
        return replace(self._observed("examined"), host=self._host, application=application)

    def observe(self) -> State:
        return self._observed("state").state

    def journal(self) -> Journal | None:
        last_run = self._looked("journal").last_run
        if isinstance(last_run, HostProblem):
            raise last_run.on(self.name)
        return last_run

    def unfinished(self) -> Journal | None:
        journal = self.journal()
        return journal if journal is not None and journal.unfinished else None

    def holder(self) -> str:
        return self._looked("holder").holder

    def _observed(self, question: str) -> SeenHost:
        observed = self._looked(question).observed
        if isinstance(observed, HostProblem):
            raise observed.on(self.name)
        return observed

    def _looked(self, question: str) -> Look:
        if self._look is None or (question in self._answered and not self._looks_once):
            look = self.ask("look", None)
            with self._readable():
                self._look, self._answered = decode(Look, look), set()
        self._answered.add(question)
        return self._look

    def ask(self, command: str, job: Json, listener: RobotListener = UNHEARD) -> Json:
        self._look = None
        listens, described = isinstance(self._channel, LiveChannel), replace(self._host, connect=None)
        request = Request(version=__version__, command=command, by=owner(), host=described, listens=listens, job=job)
        data = line_of(request)
        if len(data) > LINE_LIMIT:
            message = f"the request to the robot has {len(data):,} bytes; the limit is {LINE_LIMIT:,}"
            raise HostFailed(self.name, message, "Choose fewer components, or move unused data logs away.")
        with self._conversation(data) as conversation:
            return self._follow(conversation, listener)

    @contextmanager
    def _conversation(self, data: bytes) -> Iterator[Conversation]:
        words = entry_command()
        if isinstance(self._channel, LiveChannel):
            with self._channel.open(words) as program:
                program.send(data)
                with _saying_here(program):
                    yield program
        else:
            yield EndedConversation(self._channel.run(words, data + f"{ALL_SENT}\n".encode("ascii"), SILENCE_S))

    def _follow(self, conversation: Conversation, listener: RobotListener) -> Json:
        """Return the result; what the robot calls meanwhile is passed on."""
        look = look_for_stop(listener.should_stop, lambda: conversation.send(f"{STOP}\n".encode("ascii")))
        try:
            self._await_ready(conversation, look)
            while (line := conversation.next_line(SILENCE_S, look)) is not None:
                with self._readable():
                    answer: Answer = decode_union(Answer, parse_json(line))
                    reply = perform_call(listener, answer) if isinstance(answer, ReporterCall) else None
                match answer:
                    case Result(value=value):
                        return cast("Json", value)
                    case Failure(findings=()) if answer.outcome != "interrupted" or not listener.should_stop():
                        raise self._garbage("the failure has no reason")
                    case Failure():
                        raise EndedThere(self.name, answer)
                    case ReporterCall():
                        if reply is not None:
                            conversation.send(f"{YES if reply else NO}\n".encode("ascii"))
        except SilenceTimeout:
            raise self._broken(f"no output for {SILENCE_S / 3600:.0f} h") from None
        code = conversation.code()
        why = last_of(conversation.error_lines, code)
        raise self._broken(why if code == SSH_FAILED else f"rarms on the robot ended without a result: {why}")

    def _await_ready(self, conversation: Conversation, look: Callable[[], None]) -> None:
        """Pass over what a login prints, until the robot's rarms speaks."""
        line = await_line(
            conversation, self.name, self._channel, lambda line: line == READY or line.startswith(VERSIONS), look
        )
        if line is None:
            why = last_of(conversation.error_lines, conversation.code())
            advice = "Connect as root, or let this user start rarms with sudo without a password (docs/linux.md)."
            raise HostFailed(self.name, f"rarms does not start on {self._channel.target}: {why}", advice)
        if line != READY:
            installed = line.removeprefix(VERSIONS).split()
            raise OtherVersion(self.name, tuple(sorted(set(installed) - {"current"})))

    @contextmanager
    def _readable(self) -> Iterator[None]:
        try:
            yield
        except NotDecodable as problem:
            raise self._garbage(str(problem)) from None

    def _garbage(self, why: str) -> HostFailed:
        message = f"the answer of {self._channel.target} is not from rarms {__version__}: {why[:300]}"
        return HostFailed(self.name, message, LOOK_AT_OUTPUT)

    def _broken(self, why: str) -> HostFailed:
        message = f"the connection to {self._channel.target} broke: {why}"
        return HostFailed(self.name, message, "Run the same command again to continue.")


@contextmanager
def _saying_here(conversation: Conversation) -> Iterator[None]:
    """Send `HERE` at intervals, so that the robot knows that the connection works while a question is open."""
    ended = threading.Event()

    def say() -> None:
        while not ended.wait(HERE_S):
            conversation.send(f"{HERE}\n".encode("ascii"))

    threading.Thread(target=say, daemon=True).start()
    try:
        yield
    finally:
        ended.set()


def line_of(message: Request | Answer) -> bytes:
    """Return a message as its line."""
    return json.dumps(encode(message), separators=(",", ":"), allow_nan=False).encode("ascii") + b"\n"


def calls_sent_by(interface: type[Any], target: str, send: Callable[[ReporterCall], None], ask: Ask) -> Any:
    """Return a reporter whose calls travel to the other side.

    Args:
        interface: class of the reporter; its methods take values that the codec knows, and a bool is all they return.
        send: takes each call with its arguments.
        ask: returns the answer to the question that was sent last.
    """

    def forward(method: str) -> Callable[..., bool | None]:
        hints, is_question = _argument_hints(interface, method), _is_question(interface, method)

        def call(_self: object, *arguments: object) -> bool | None:
            data: Json = [encode(value, hint) for value, hint in zip(arguments, hints, strict=True)]
            send(ReporterCall(target=target, method=method, arguments=data))
            return ask() if is_question else None

        return call

    methods = {name: forward(name) for name in _methods_of(interface)}
    return type(f"Sent{interface.__name__}", (interface,), methods)()


def perform_call(listener: RobotListener, call: ReporterCall) -> bool | None:
    """Make a call of the other side here, and return the answer if it is a question.

    Raises:
        NotDecodable: no such reporter or method, or the arguments do not fit it.
    """
    if call.target not in listener.reporters:
        raise NotDecodable("target", f"there is no {call.target[:40]}")
    interface, reporter = listener.reporters[call.target]
    if call.method not in _methods_of(interface):
        raise NotDecodable("method", f"{interface.__name__} has no {call.method[:40]}")
    hints = _argument_hints(interface, call.method)
    if not isinstance(call.arguments, list) or len(call.arguments) != len(hints):
        raise NotDecodable("arguments", f"{interface.__name__}.{call.method} takes {len(hints)}")
    arguments = (decode_union(hint, each) for hint, each in zip(hints, call.arguments, strict=True))
    answer = getattr(reporter, call.method)(*arguments)
    return bool(answer) if _is_question(interface, call.method) else None


def _methods_of(interface: type[Any]) -> tuple[str, ...]:
    own = dict.fromkeys(name for each in interface.__mro__ for name in vars(each) if not name.startswith("_"))
    return tuple(name for name in own if callable(getattr(interface, name)))


def _is_question(interface: type[Any], method: str) -> bool:
    return get_type_hints(getattr(interface, method)).get("return") is bool


def _argument_hints(interface: type[Any], method: str) -> tuple[Any, ...]:
    hints = get_type_hints(getattr(interface, method))
    return tuple(hint for name, hint in hints.items() if name != "return")
