"""Resolves what is to be started: the words, the folder and the environment of a component or load.

A component comes in as its `run`, a `StartOrder` with a `ProcessOrder` for each process goes out. Begin at `order_of`.
`environment.py` makes the variables and users of a process, `engines.py` the words that start containers and services.
"""

import json
import os
import shlex
import shutil
import signal
import sys
import tempfile
from collections.abc import Mapping
from dataclasses import replace
from pathlib import Path
from typing import NoReturn, assert_never

from rarms_iac.model.run import (
    AttachedContainer,
    AttachedService,
    Call,
    Command,
    Container,
    Periodic,
    Process,
    Processes,
    Run,
    Service,
    Stop,
)
from rarms_iac.running.engines import EngineStart, container_words, log_words, service_words, with_whole_path
from rarms_iac.running.environment import (
    PERIOD_VARIABLE,
    as_user,
    changed_digests,
    environment_of,
    file_variables,
    own_program,
    with_setup,
)
from rarms_iac.running.orders import CannotStart, ProcessOrder, ProcessPlace, StartContext, StartOrder, order_as_json
from rarms_iac.running.run_exec import own_variable
from rarms_iac.texts.messages import reason_of

SUPERVISOR = Path(__file__).resolve().with_name("supervisor_process.py")
CALLER = Path(__file__).resolve().with_name("caller.py")


def order_of(component: str, run: Run, context: StartContext) -> StartOrder:
    """Return the order to start the component.

    Raises:
        CannotStart: a folder, a program, a user or a variable of rarms' own environment is not there.
    """
    processes = []
    for name, process in run.each_process.items():
        is_sampled = not name or name == run.samples.process
        order = _order_of_process(component, run, process, _context_of(context, is_sampled=is_sampled))
        stream = run.samples.stream if run.has_lines else "stdout"
        processes.append(replace(order, name=name, stream=stream if is_sampled else None))
    file, socket = (context.base / name if name else None for name in (run.samples.file, run.samples.socket))
    return StartOrder(
        name=component,
        processes=tuple(processes),
        stop=run.stop,
        file=file,
        socket=socket,
        threads=context.inside.threads,
        groups=context.inside.groups,
    )


def _context_of(context: StartContext, *, is_sampled: bool) -> StartContext:
    """Give the deadline or task class to one of several processes: a deadline is admitted once for a partition."""
    return context if is_sampled else replace(context, inside=replace(context.inside, priority=()))


def order_of_words(name: str, words: tuple[str, ...], context: StartContext) -> StartOrder:
    """Return a program and its arguments as they are started in the manifest's folder.

    Raises:
        CannotStart: the program is not there.
    """
    before = (*_on_own_path(context.inside.words), *_on_own_path(context.inside.priority))
    order = _order_in(name, words, before, context.base, context)
    return StartOrder(name=name, processes=(order,), stop=Stop())


def _order_of_process(component: str, run: Run, process: Process, context: StartContext) -> ProcessOrder:
    folder = context.base / process.folder
    if not folder.is_dir():
        raise CannotStart(component, f"its folder {folder} does not exist")
    before = environment_of(component, process, run.arrival, context)
    environment = with_setup(component, process, before, context.base)
    own = replace(context, environment=environment)
    match process.start:
        case Command(words=words):
            return _order_as_user(component, process, words, folder, own)
        case Call() as call:
            return _order_as_user(component, process, _call_words(call, run, context), folder, own)
        case Container() | Service():
            changed = {name for name, value in environment.items() if before.get(name) != value}
            period = {PERIOD_VARIABLE} if isinstance(run.arrival, Periodic) else set()
            named = {*process.variables, *file_variables(component, process, context.base), *period, *changed}
            values = {**environment, **context.inside.environment}
            variables = {name: values[name] for name in sorted({*named, *context.inside.environment})}
            return _order_of_engine(component, process, run.stop, context, variables)
        case AttachedService() | AttachedContainer() as attached:
            outside = replace(own, inside=ProcessPlace())
            return _order_in(component, log_words(component, attached), (), folder, outside)
        case Processes():
            raise AssertionError("a process of several is one")
        case never:
            assert_never(never)


def setup_digests(component: str, run: Run, context: StartContext) -> dict[str, str]:
    """Return a digest of each variable that setup files change, as `variable NAME of COMPONENT`.

    Raises:
        CannotStart: the files cannot be sourced.
    """
    found: dict[str, str] = {}
    for process in run.each_process.values():
        before = environment_of(component, process, run.arrival, context)
        after = with_setup(component, process, before, context.base)
        found |= {f"variable {name} of {component}": value for name, value in changed_digests(before, after).items()}
    return found


def _order_as_user(
    component: str, process: Process, words: tuple[str, ...], folder: Path, context: StartContext
) -> ProcessOrder:
    own = (*_on_own_path(context.inside.words), *_on_own_path(context.inside.priority))
    user, environment = as_user(component, process, context.environment, is_below_root=bool(own))
    order = _order_in(component, words, (*own, *user), folder, context)
    return replace(order, environment={**environment, **context.inside.environment})


def _order_of_engine(
    component: str, process: Process, stop: Stop, context: StartContext, variables: Mapping[str, str]
) -> ProcessOrder:
    """Return the order of a container or service.

    The program of a container's engine joins the partition, too. It has the environment of rarms, as root may run it.
    """
    inside, folder = context.inside, context.base / process.folder
    if inside.priority:
        advice = "Set the class for its threads: `task: { class: ..., threads: [...] }`."
        message = "a container or service cannot have a task class or deadline for the whole process"
        raise CannotStart(component, message, advice)
    made: EngineStart
    if process.container is not None:
        placed = replace(process, container=with_whole_path(process.container, context.base))
        made, before = container_words(component, placed, stop, inside.parent, variables), inside.words
    else:
        made, before = service_words(component, process, stop, inside.parent, variables, folder.resolve()), ()
    order = _order_in(component, made.words, _on_own_path(before), folder, context)
    ending, program = made.ending, _program(component, made.ending.stop[0], folder, context.environment)
    return replace(
        order,
        environment=context.environment,
        variables=made.variables,
        ending=replace(
            ending,
            stop=(program, *ending.stop[1:]),
            remove=tuple((program, *words[1:]) for words in ending.remove),
        ),
    )


def _order_in(
    component: str, words: tuple[str, ...], before: tuple[str, ...], folder: Path, context: StartContext
) -> ProcessOrder:
    resolved = (
        words if folder.resolve() == context.base.resolve() else tuple(_word(word, context.base) for word in words)
    )
    program = _program(component, (*before, *resolved)[0], folder, context.environment)
    if before:
        resolved = (_program(component, resolved[0], folder, context.environment), *resolved[1:])
    return ProcessOrder(
        name="",
        words=(program, *(*before, *resolved)[1:]),
        folder=folder.resolve(),
        environment={**context.environment, **context.inside.environment},
        join=context.inside.join,
    )


def _on_own_path(words: tuple[str, ...]) -> tuple[str, ...]:
    return (own_program(words[0]), *words[1:]) if words else ()


def become(order: StartOrder, component: str) -> NoReturn:
    """Turn this process into a component: it joins its control groups, and keeps the standard streams that it has.

    A container, a service and several processes get a supervisor, which this process becomes. Only on POSIX: Windows
    starts another process instead.

    Args:
        component: As `ExecProcess.component`.

    Raises:
        CannotStart: a control group, the folder or the program refuses it.
    """
    sys.stdout.flush()
    sys.stderr.flush()
    if sys.platform != "win32":
        signal.signal(signal.SIGPIPE, signal.SIG_DFL)  # Python ignores it, and a process inherits that
    process, itself = order.processes[0], own_variable(component)
    try:
        if len(order.processes) > 1 or process.ending is not None:
            words = (sys.executable, "-I", "-S", str(SUPERVISOR), str(_open_order(order)))
            os.execve(words[0], words, {**os.environ, **itself})  # noqa: S606 - so it is meant
        for file in process.join:
            file.write_text(str(os.getpid()), encoding="ascii")
        os.chdir(process.folder)
        os.execve(process.words[0], process.words, {**process.environment, **itself})  # noqa: S606 - so it is meant
    except OSError as problem:
        raise CannotStart(order.name, f"{problem.filename or process.folder}: {reason_of(problem)}") from problem


def _open_order(order: StartOrder) -> int:
    """Return an open file without a name that has the order, for the program that this process becomes."""
    with tempfile.TemporaryFile() as file:
        file.write(json.dumps(order_as_json(order)).encode("ascii"))
        file.flush()
        handle = os.dup(file.fileno())
    os.lseek(handle, 0, os.SEEK_SET)
    os.set_inheritable(handle, True)
    return handle


def _call_words(call: Call, run: Run, context: StartContext) -> tuple[str, ...]:
    base = str(context.base.resolve())
    period = str(float(run.arrival.period)) if isinstance(run.arrival, Periodic) else "0"
    reads_values = any((run.samples.response_time, run.samples.success, run.samples.count))
    paced = (period, "values" if reads_values else "none")
    return (sys.executable, "-P", str(CALLER), base, call.module, call.function, *paced, context.inside.task)


def _word(word: str, base: Path) -> str:
    """Return a word that names a file is relative to the manifest, in any folder that the component runs in."""
    try:
        names_a_file = bool(word) and not word.startswith("-") and (base / word).exists()
    except (OSError, ValueError):  # too long, or with a character that no file's name has
        names_a_file = False
    return str((base / word).resolve()) if names_a_file else word


def _program(component: str, word: str, folder: Path, environment: Mapping[str, str]) -> str:
    if not word or "\0" in word:
        raise CannotStart(component, "its command does not contain a program")
    if os.sep in word or (os.altsep and os.altsep in word):
        program = folder.resolve() / word
        if not program.is_file():
            raise CannotStart(component, f"the program {program} does not exist")
        if not os.access(program, os.X_OK):  # root, too, starts only files that somebody may execute
            advice = f"Make it executable: chmod +x {shlex.quote(str(program))}"
            raise CannotStart(component, f"the program {program} is not executable", advice)
        return str(program)
    path = shutil.which(word, path=environment.get("PATH", os.defpath))
    if path is None and word in {"python3", "python"}:
        path = sys.executable  # rarms itself runs on one: Windows has no python3, a venv is not always on the PATH
    if path is None:
        raise CannotStart(component, f'the program "{word}" is not on the PATH')
    return str(Path(path).absolute())
