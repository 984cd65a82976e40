"""Progress while a plan is applied: a line a step; on a terminal the running step stands there with its start."""

from collections.abc import Callable

from rarms_iac.apply.run_report import ToldStep
from rarms_iac.model.journal import RunKind, StepStatus
from rarms_iac.views.diagnostics.layout import columns, hanging, visible

WRITE_OVER = "\r\x1b[K"
LONGEST = 500
"""Characters that are shown of a line that a host says beside its steps."""


class StepProgress:
    """A `RunReporter` that writes to a person.

    Args:
        write: takes a piece of text and shows it at once.
        clock: seconds, from any start.
        lively: lines may be written over; otherwise every line is whole, and nothing is written twice.
        width: columns of a line that may be written over.
    """

    def __init__(self, write: Callable[[str], None], clock: Callable[[], float], *, lively: bool, width: int) -> None:
        self._write = write
        self._clock = clock
        self._lively = lively
        self._width = width
        self._since = 0.0

    def run_started(self, host: str, run: RunKind, plan: str, *, done: int) -> None:
        """Say what begins or goes on."""
        what = "Applying" if run is RunKind.APPLY else "Undoing"
        goes_on = f", going on after step {done}" if done else ""
        self._write(f"{what} plan {plan} on {host}{goes_on}\n")

    def step_started(
        self,
        host: str,  # noqa: ARG002 - `run_started` names it, and hosts are walked one at a time
        number: int,
        total: int,
        step: ToldStep,
    ) -> None:
        """Show the running step where it can be written over."""
        self._since = self._clock()
        if self._lively:
            self._write(WRITE_OVER + fitting(f"{step_line(number, total, step)} ...", self._width))

    def step_ended(
        self,
        host: str,  # noqa: ARG002 - one host at a time
        number: int,
        total: int,
        step: ToldStep,
        status: StepStatus,
    ) -> None:
        """Show what became of it and how long it took."""
        took = self._clock() - self._since
        says = "as wanted already" if status is StepStatus.UNCHANGED else f"done in {seconds(took)}"
        if self._lively:
            lines = hanging(counter(number, total), f"{step_says(step)}: {says}", self._width)
            self._write(WRITE_OVER + "".join(f"{line}\n" for line in lines))
        else:
            self._write(f"{step_line(number, total, step)}: {says}\n")

    def said(self, host: str, line: str) -> None:
        """Show it apart from the steps, without whatever would move the cursor."""
        self._write(f"{WRITE_OVER if self._lively else ''}  {host} says: {visible(line[:LONGEST], keep='')}\n")


def step_line(number: int, total: int, step: ToldStep) -> str:
    """`  [ 3/12] partition/vision: reserve 70 -> 40 %`."""
    return counter(number, total) + step_says(step)


def counter(number: int, total: int) -> str:
    """`  [ 3/12] `."""
    return f"  [{number:>{len(str(total))}}/{total}] "


def step_says(step: ToldStep) -> str:
    """`partition/vision: reserve 70 -> 40 %`."""
    return f"{step.address}: {visible(step.title, keep='')}"


def seconds(time: float) -> str:
    """`0.1 s`, `75 s`: no more digits than a person reads."""
    return f"{time:.1f} s" if time < 10 else f"{time:.0f} s"


def fitting(text: str, width: int) -> str:
    """The text, cut so that the cursor stays on its line."""
    while columns(text) >= width:
        text = text[:-1]
    return text
