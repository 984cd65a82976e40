"""Calls a component's function, job after job, and tells what each showed. A program of its own (`run.call`).

Words: the manifest's folder, module, function, the period in ms (0: the next job starts when the last one ended),
and `values` where what the function returns is to be told. Standard library only: the component brings the rest.

What it tells is a JSON object a line on what was its standard output; what the function prints goes to standard
error instead, so that nothing it prints can be taken for a sample.
"""

import importlib
import json
import os
import sys
import time
from collections.abc import Callable, Mapping

LONGEST = 60_000


def main(words: list[str]) -> None:
    """Load the function, then call it until nobody listens."""
    base, module, name, period, told = words
    answers = os.dup(1)
    os.dup2(2, 1)
    sys.path[:0] = list(dict.fromkeys([os.getcwd(), base]))  # noqa: PTH109 - what Python itself would put there
    try:
        function = getattr(importlib.import_module(module), name)
    except BaseException as error:
        tell(answers, cannot=described(error))
        raise
    if not callable(function):
        tell(answers, cannot=f"{module}:{name} is not a function")
        return
    begun = time.perf_counter()
    tell(answers, ready=begun)
    call(function, begun, float(period) / 1000, lambda **what: tell(answers, **what), values=told == "values")


def call(
    function: Callable[[], object], begun: float, period: float, say: Callable[..., None], *, values: bool
) -> None:
    """One job after another; a periodic one is due at its time, whatever those before it took."""
    number = 0
    while True:
        due = begun + number * period if period else time.perf_counter()
        while (wait := due - time.perf_counter()) > 0:
            time.sleep(wait)
        number += 1
        try:
            result = function()
        except Exception as error:  # noqa: BLE001 - an exception of the function is a failed sample
            say(due=due, error=described(error))
            continue
        ended = time.perf_counter()
        say(due=due, response=1000 * (ended - due), **({"result": sendable(result)} if values else {}))


def sendable(result: object) -> object:
    """What the function returned, where it is a text or a map that can be told."""
    kept = dict(result) if isinstance(result, Mapping) else result if isinstance(result, str) else None
    return kept if len(json.dumps(kept, default=str)) <= LONGEST else None


def described(error: BaseException) -> str:
    """The exception in a line."""
    return " ".join(f"{type(error).__name__}: {error}".split())[:500]


def tell(answers: int, **what: object) -> None:
    """One write, which a pipe does not tear."""
    os.write(answers, json.dumps(what, default=str).encode() + b"\n")


if __name__ == "__main__":
    main(sys.argv[1:])
