"""What a line of a component's output says: of a command's as the manifest reads it, of a function's as we tell it."""

import json
from collections.abc import Callable
from dataclasses import dataclass, replace

from rarms_iac.model.system import Call, Run
from rarms_iac.running.reading import Read, Reading, Unreadable, read_values, reader


@dataclass(frozen=True, slots=True, kw_only=True)
class Answer:
    """A job's answer; or that the function is loaded, that it cannot be, or that it raised."""

    reading: Reading = Reading()
    began: float | None = None  # where the runner knows it; a periodic job's scheduled start
    ready: float | None = None
    cannot: str = ""
    failure: str = ""


Listens = Callable[[str, float], Answer | Unreadable | None]
"""A line and when it came to what it says; None where that is nothing about a job."""


def listener(run: Run) -> Listens:
    """How this component's lines are understood."""
    read = reader(run.samples)
    if isinstance(run.start, Call):
        return lambda line, _at: _of_caller(run, read, line)

    def of_command(line: str, _at: float) -> Answer | Unreadable | None:
        found = read(line)
        return Answer(reading=found) if isinstance(found, Reading) else found

    return of_command


def _of_caller(run: Run, read: Read, line: str) -> Answer | Unreadable | None:
    told = json.loads(line)
    match told:
        case {"ready": float(ready)}:
            return Answer(ready=ready)
        case {"cannot": str(cannot)}:
            return Answer(cannot=cannot)
        case {"due": float(due), "error": str(error)}:
            return Answer(began=due, failure=error)
        case {"due": float(due), "response": float(response)}:
            found = _of_result(run, read, told.get("result"), response)
            return Answer(reading=found, began=due) if isinstance(found, Reading) else found
        case _:
            return Unreadable(says=f"the runner's line {line[:60]!r}")


def _of_result(run: Run, read: Read, result: object, response: float) -> Reading | Unreadable:
    """The job by the clock of who called it, and by what the function returned where the manifest names fields."""
    samples = run.samples
    if not any((samples.response_time, samples.success, samples.count)):
        return Reading(response_ms=response)
    if samples.source == "pattern":
        found = read(result) if isinstance(result, str) else None
        found = found or Unreadable(says="the function returned no text that the pattern matches")
    elif isinstance(result, dict):
        found = read_values(samples, result, json.dumps(result))
    else:
        return Unreadable(says="the function returned no map with the fields that `run.samples` names")
    if isinstance(found, Reading) and samples.response_time is None:
        return replace(found, response_ms=response)
    return found
