"""Resolves what is to be started: the words, the folder and the environment of a component or load.

What a component prints is recorded in git. Values that it gets from rarms' own environment are not: `hide_secrets`.
"""

import json
import os
import shutil
import signal
import sys
from base64 import b64encode, urlsafe_b64encode
from collections.abc import Callable, Iterable, Iterator, Mapping
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import NoReturn
from urllib.parse import quote, quote_plus

from rarms_iac.model.diagnostics import Diagnostic, Finding, Places
from rarms_iac.model.run import Call, Command, FromEnvironment, OutputStream, Periodic, Run, Stop
from rarms_iac.model.system import Component
from rarms_iac.model.wording import quoted, reason_of


class RunningError(Exception):
    """Something about a component's processes that its samples cannot tell."""


class CannotStart(RunningError):
    """The component cannot be started as its `run` in the manifest asks."""

    def __init__(self, component: str, message: str, advice: str = "") -> None:
        super().__init__(f"{component}: {message}")
        self.component = component
        self.message = message
        self.advice = advice  # empty: what helps where a program is not found


class SupervisorLost(RunningError):
    """The process between rarms and the component is gone: it was killed, and the component was ended with it."""

    def __init__(self, component: str, message: str) -> None:
        super().__init__(f"{component}: {message}")
        self.component = component
        self.message = message


PERIOD_VARIABLE = "RARMS_PERIOD_MS"
"""Tells a command that paces itself its period, as a number of milliseconds."""

CALLER = Path(__file__).resolve().with_name("caller.py")


@dataclass(frozen=True, slots=True, kw_only=True)
class ProcessPlace:
    """Where a component's processes are to be; empty: with everything else on the machine.

    `words` stand before the component's own (`chrt`, `taskset`); `join` are files that take the process' id before
    the component begins (`cgroup.procs`), so that nothing of it ever runs outside. `environment` is for `rcss`, and
    `task` is the class that the caller's thread joins, where only the thread itself can (Windows). `groups` are the
    folders of control groups in which all of its processes must be, and that count their processor time;
    `memory_events` is the file in which the kernel counts the processes that it killed for the group's memory.
    """

    words: tuple[str, ...] = ()
    join: tuple[Path, ...] = ()
    environment: Mapping[str, str] = field(default_factory=dict)
    task: str = ""
    groups: tuple[Path, ...] = ()
    memory_events: Path | None = None


@dataclass(frozen=True, slots=True, kw_only=True)
class StartOrder:
    """A process as the supervisor starts it."""

    name: str
    words: tuple[str, ...]  # the program's whole path first
    folder: Path
    environment: Mapping[str, str]
    stop: Stop
    join: tuple[Path, ...] = ()
    stream: OutputStream = "stdout"  # whose lines are read


@dataclass(frozen=True, slots=True, kw_only=True)
class StartContext:
    """The surroundings of a component's start: the manifest's folder, rarms' own environment, and the partition."""

    base: Path
    environment: Mapping[str, str] = field(default_factory=lambda: dict(os.environ))
    inside: ProcessPlace = field(default_factory=ProcessPlace)


def order_of(component: str, run: Run, context: StartContext) -> StartOrder:
    """Return the order to start the component.

    Raises:
        CannotStart: a folder, a program or a variable of rarms' own environment is not there.
    """
    folder = context.base / run.folder
    if not folder.is_dir():
        raise CannotStart(component, f"its folder {folder} is not there")
    own = replace(context, environment=environment_of(component, run, context.environment))
    order = _order_in(folder, component, _words(run, context), own, run.stop)
    return replace(order, stream=run.samples.stream) if run.has_lines else order


def order_of_words(name: str, words: tuple[str, ...], context: StartContext) -> StartOrder:
    """Return a program and its arguments as they are started in the manifest's folder.

    Raises:
        CannotStart: the program is not there.
    """
    return _order_in(context.base, name, words, context, Stop())


def _order_in(folder: Path, name: str, words: tuple[str, ...], context: StartContext, stop: Stop) -> StartOrder:
    resolved = (
        words if folder.resolve() == context.base.resolve() else tuple(_word(word, context.base) for word in words)
    )
    before = context.inside.words
    program = _program(name, (*before, *resolved)[0], folder, context.environment)
    if before:
        resolved = (_program(name, resolved[0], folder, context.environment), *resolved[1:])
    return StartOrder(
        name=name,
        words=(program, *(*before, *resolved)[1:]),
        folder=folder.resolve(),
        environment={**context.environment, **context.inside.environment},
        stop=stop,
        join=context.inside.join,
    )


def become(order: StartOrder) -> NoReturn:
    """Turn this process into a component: it joins its control groups, and keeps the standard streams that it has.

    Only on POSIX: Windows starts another process instead.

    Raises:
        CannotStart: a control group, the folder or the program refuses it.
    """
    sys.stdout.flush()
    sys.stderr.flush()
    if sys.platform != "win32":
        signal.signal(signal.SIGPIPE, signal.SIG_DFL)  # Python ignores it, and a process inherits that
    try:
        for file in order.join:
            file.write_text(str(os.getpid()), encoding="ascii")
        os.chdir(order.folder)
        os.execve(order.words[0], order.words, order.environment)  # noqa: S606 - so it is meant
    except OSError as problem:
        raise CannotStart(order.name, f"{problem.filename or order.folder}: {reason_of(problem)}") from problem


def environment_of(component: str, run: Run, own: Mapping[str, str]) -> dict[str, str]:
    """Return rarms' environment with the manifest's variables, and the period for a command that paces itself.

    Raises:
        CannotStart: a variable that a value is to be read from is not set.
    """
    environment = dict(own)
    if isinstance(run.arrival, Periodic):
        environment[PERIOD_VARIABLE] = f"{float(run.arrival.period):.12g}"
    for name, value in run.environment.items():
        if isinstance(value, FromEnvironment):
            if value.name not in own:
                message = f"{name} is to come from the variable {value.name}, which is not set where rarms runs"
                advice = f"Set {value.name} where rarms runs; on a Linux host over ssh, in /etc/rarms/environment."
                raise CannotStart(component, message, advice)
            environment[name] = own[value.name]
        else:
            environment[name] = value
    return environment


def _words(run: Run, context: StartContext) -> tuple[str, ...]:
    match run.start:
        case Command(words=words):
            return words
        case Call(module=module, function=function):
            base = str(context.base.resolve())
            return (sys.executable, "-P", str(CALLER), base, module, function, *_pace(run), context.inside.task)


def _pace(run: Run) -> tuple[str, str]:
    period = str(float(run.arrival.period)) if isinstance(run.arrival, Periodic) else "0"
    reads_values = any((run.samples.response_time, run.samples.success, run.samples.count))
    return period, "values" if reads_values else "none"


def _word(word: str, base: Path) -> str:
    """Return a word that names a file is relative to the manifest, in any folder that the component runs in."""
    try:
        names_a_file = bool(word) and not word.startswith("-") and (base / word).exists()
    except (OSError, ValueError):  # too long, or with a character that no file's name has
        names_a_file = False
    return str((base / word).resolve()) if names_a_file else word


def _program(component: str, word: str, folder: Path, environment: Mapping[str, str]) -> str:
    if not word or "\0" in word:
        raise CannotStart(component, "its command names no program")
    if os.sep in word or (os.altsep and os.altsep in word):
        program = folder.resolve() / word
        if not program.is_file():
            raise CannotStart(component, f"there is no program {program}")
        return str(program)
    path = shutil.which(word, path=environment.get("PATH", os.defpath))
    if path is None and word in {"python3", "python"}:
        path = sys.executable  # rarms itself runs on one: Windows has no python3, a venv is not always on the PATH
    if path is None:
        raise CannotStart(component, f'there is no program "{word}" on the PATH')
    return str(Path(path).absolute())


LEAST = 6
"""Characters of a value that is looked for: a shorter one stands in other words, too."""

LINE = 76
"""Characters after which programs break a line of base64."""


def hide_secrets(run: Run, own: Mapping[str, str]) -> Callable[[str], str]:
    """Make the function that takes the values of `from_env` variables out of a text.

    Returns:
        A function of a text, which has `<NAME>` in place of each value of at least `LEAST` characters, as it is, in
        base64, or as JSON, Python, an address or a message writes it, whole or line by line; the longest first, so that
        none is left in part. Of a value that is cut off by an end of the text, or by `...`, the remainder is replaced,
        if it is as long.
    """
    names = {value.name for value in run.environment.values() if isinstance(value, FromEnvironment)}
    forms = {
        form: name
        for name in sorted(names)
        if len(value := own.get(name, "")) >= LEAST
        for part in (value, *value.splitlines())
        if len(part) >= LEAST
        for form in _forms(part)
    }
    ordered = sorted(forms, key=lambda form: (-len(form), form))

    def hide(text: str) -> str:
        for form in ordered:
            text = text.replace(form, f"<{forms[form]}>")
        for form in ordered:
            text = _without_cut_off(text, form, f"<{forms[form]}>")
        return text

    return hide


def _without_cut_off(text: str, form: str, name: str) -> str:
    """Return the text without a cut form of a value at its beginning, at its end or before `...`."""
    if form[:LEAST] in text:
        for size in range(len(form) - 1, LEAST - 1, -1):
            text = text.replace(f"{form[:size]}...", f"{name}...")
            if text.endswith(form[:size]):
                text = f"{text[:-size]}{name}"
    if form[-LEAST:] in text:
        for size in range(len(form) - 1, LEAST - 1, -1):
            if text.startswith(form[-size:]):
                return f"{name}{text[size:]}"
    return text


def _forms(value: str) -> tuple[str, ...]:
    as_json = (json.dumps(value)[1:-1], json.dumps(value, ensure_ascii=False)[1:-1])
    as_python = (repr(value)[1:-1], ascii(value)[1:-1])  # what an exception of a component often shows
    # Bytes that are no text are written as they came.
    in_addresses = (write(value, errors="surrogateescape") for write in (quote, quote_plus))
    return (value, *as_json, *as_python, quoted(value)[1:-1], *in_addresses, *_as_base64(value))


def _as_base64(value: str) -> Iterator[str]:
    """Yield base64 of a value in both alphabets: alone, also in lines, and inside of a longer text (`user:password`).

    A character stands for six bits. So it matters how many bytes stand before the value, modulo three; inside of a
    text, characters that also stand for bits of a neighbour are left out.
    """
    data = value.encode("utf-8", errors="surrogateescape")
    for encode in (b64encode, urlsafe_b64encode):
        alone = encode(data).decode("ascii")
        lines = (alone[at : at + LINE] for at in range(0, len(alone), LINE))
        yield from (alone, alone.rstrip("="), *(line for line in lines if len(line) >= LEAST))
        for before in range(3):
            text = encode(bytes(before) + data).decode("ascii")
            yield text[-(-8 * before // 6) : 8 * (before + len(data)) // 6]


SHORT_SECRET = Finding.warning("RARMS345", "A value from the environment is too short to be hidden")


def short_secrets(components: Iterable[Component], places: Places) -> Iterator[Diagnostic]:
    """Find values of rarms' own environment that are too short to be found in what components print.

    Args:
        components: whose `from_env` variables are looked at.

    Yields:
        A warning for each such variable of a component; it tells neither the value nor its length.
    """
    for component in components:
        for variable, value in (component.run.environment if component.run is not None else {}).items():
            if isinstance(value, FromEnvironment) and 0 < len(os.environ.get(value.name, "")) < LEAST:
                yield SHORT_SECRET.at(
                    places.value("components", component.name, "run", "environment", variable),
                    "{variable} has fewer than {least} characters here: what {component:quoted} prints of "
                    "it is shown and recorded as it is.",
                    f"Give it a value of at least {LEAST} characters if it is a secret.",
                    address=f"component/{component.name}",
                    component=component.name,
                    variable=value.name,
                    least=LEAST,
                )
