"""A component's run on this machine: its processes started, watched and ended, its samples as they happen."""

from collections.abc import Generator, Iterator
from types import TracebackType
from typing import Self

from rarms_iac.model.measurement import Sample, Series
from rarms_iac.model.system import Call, Run
from rarms_iac.running.kept import Interrupted, Kept
from rarms_iac.running.order import Surroundings, order_of
from rarms_iac.running.per_line import samples_of_lines
from rarms_iac.running.per_run import samples_of_runs
from rarms_iac.running.record import Ending, Record


def run_component(component: str, run: Run, around: Surroundings) -> "ComponentRun":
    """The component's run, not begun yet: a context manager, and an iterator of samples.

    Raises:
        CannotStart: a folder, a program or a variable is not there. Iterating raises it, too, and `KeeperLost`.
    """
    return ComponentRun(component, run, around)


class ComponentRun:
    """Yields each sample as it happens, failed ones too; leaves no process behind when it is closed.

    The setting begins with the first job (docs/running.md). The samples end as `ending` says: after `run.until`, with
    more failed ones than `run.failures`, or when it is closed, at any moment.
    """

    def __init__(self, component: str, run: Run, around: Surroundings) -> None:
        self.component = component
        self._order = order_of(component, run, around)
        self._record = Record(run)
        self._kept: Kept | None = None
        self._interrupted = False
        self._samples = self._begin()

    def __enter__(self) -> Self:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self.close()

    def __iter__(self) -> Iterator[Sample]:
        return self

    def __next__(self) -> Sample:
        return next(self._samples)

    def interrupt(self) -> None:
        """Have the thread that reads the samples see no more of them; it is the one to close."""
        self._interrupted = True
        if self._kept is not None:
            self._kept.interrupt()

    def close(self) -> None:
        """Stop it as its `stop` says, and wait until nothing of it is left; may be called twice."""
        if self._record.ending is Ending.RUNNING:
            self._record.ending = Ending.CLOSED
        self._samples.close()

    def series(self) -> Series:
        """All samples so far; once it is closed, with the processor time of all of the component's processes."""
        return Series(
            component=self.component,
            samples=tuple(self._record.samples),
            elapsed_ms=self._record.elapsed_ms,
            cpu_ms=self._kept.cpu_ms if self._kept else None,
        )

    @property
    def ending(self) -> Ending:
        """Why no more samples come."""
        return self._record.ending

    @property
    def failed(self) -> int:
        """How many of the samples are failed ones."""
        return self._record.failed

    @property
    def tail(self) -> str:
        """The last that the component wrote to standard error: at most 4 KiB."""
        return self._kept.tail if self._kept else ""

    def _begin(self) -> Generator[Sample, None, None]:
        kept = self._kept = Kept(self._order)
        if self._interrupted:
            kept.interrupt()
        try:
            per_run = self._record.run.samples.source == "per_run" and not isinstance(self._record.run.start, Call)
            yield from (
                samples_of_runs(kept, self._record) if per_run else samples_of_lines(self.component, kept, self._record)
            )
        except Interrupted:
            self._record.ending = Ending.CLOSED
        finally:
            kept.close()
