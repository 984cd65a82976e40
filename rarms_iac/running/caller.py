"""Calls a component's function, job after job, and sends the outcome of each. A program of its own (`run.call`).

Arguments: the manifest's folder, module, function, the period in ms (0: the next job starts when the last one ended),
`values` where what the function returns is to be sent, and the task class that this thread joins; empty: none. Standard
library only: the component brings the rest.

It sends a JSON object a line on what was its standard output; what the function prints goes to standard
error instead, so that nothing it prints can be taken for a sample.
"""

import functools
import importlib
import importlib.util
import json
import os
import sys
import time
from collections.abc import Callable, Mapping
from contextlib import AbstractContextManager, ExitStack, nullcontext
from pathlib import Path

LONGEST = 60_000


def main(words: list[str]) -> None:
    """Load the function, then call it until its reader has gone."""
    base, module, name, period, sends, task = words
    answers = os.dup(1)
    os.dup2(2, 1)
    sys.path[:0] = list(dict.fromkeys([os.getcwd(), base]))  # noqa: PTH109 - what Python itself would put there
    with ExitStack() as memberships:
        try:
            function = getattr(importlib.import_module(module), name)
            memberships.enter_context(task_class(task))
        except BaseException as error:
            send(answers, cannot=describe(error))
            raise
        if not callable(function):
            send(answers, cannot=f"{module}:{name} is not a function")
            return
        begun = time.perf_counter()
        send(answers, ready=begun)
        report = functools.partial(send, answers)
        call(function, begun, float(period) / 1000, report, with_result=sends == "values")


def task_class(name: str) -> AbstractContextManager[None]:
    """Join a task class in the context; rarms need not be among the modules of this program."""
    if not name:
        return nullcontext()
    spec = importlib.util.spec_from_file_location("rcss", Path(__file__).resolve().parents[1] / "rcss.py")
    assert spec is not None
    assert spec.loader is not None
    rcss = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(rcss)
    membership: AbstractContextManager[None] = rcss.robotic_task(name)
    return membership


def call(
    function: Callable[[], object], begun: float, period: float, report: Callable[..., None], *, with_result: bool
) -> None:
    """Run one job after another; a periodic one is due at its time, however long those before it took."""
    number = 0
    while True:
        due = begun + number * period if period else time.perf_counter()
        while (wait := due - time.perf_counter()) > 0:
            time.sleep(wait)
        number += 1
        try:
            result = function()
        except Exception as error:  # noqa: BLE001 - an exception of the function is a failed sample
            report(due=due, error=describe(error))
            continue
        ended = time.perf_counter()
        report(due=due, response=1000 * (ended - due), **({"result": sendable(result)} if with_result else {}))


def sendable(result: object) -> object:
    """Return the function's result if it is a text or a map that can be sent."""
    value = dict(result) if isinstance(result, Mapping) else result if isinstance(result, str) else None
    return value if len(json.dumps(value, default=str)) <= LONGEST else None


def describe(error: BaseException) -> str:
    """Write the exception in one line of at most 500 characters."""
    return " ".join(f"{type(error).__name__}: {error}".split())[:500]


def send(answers: int, **values: object) -> None:
    """Send a JSON object in one write, which a pipe does not tear."""
    os.write(answers, json.dumps(values, default=str).encode() + b"\n")


if __name__ == "__main__":
    main(sys.argv[1:])
