"""Several components at once: their samples as they happen, whoever's they are."""

import queue
import threading
from collections.abc import Iterator, Sequence
from contextlib import contextmanager

from rarms_iac.model.measurement import Sample
from rarms_iac.running.component import ComponentRun

WAITING = 256


@contextmanager
def together(runs: Sequence[ComponentRun]) -> Iterator[Iterator[tuple[str, Sample]]]:
    """The samples of all of them with the component's name, until each has ended; at the end all are closed.

    Each ends as its own `until` says; leaving the `with` ends them all, at any moment. An exception of one
    (`CannotStart`, `KeeperLost`) is raised to who reads the samples.
    """
    told: queue.Queue[tuple[str, Sample | BaseException | None]] = queue.Queue(WAITING)
    threads = [threading.Thread(target=_drive, args=(run, told), daemon=True) for run in runs]
    for thread in threads:
        thread.start()
    try:
        yield _samples(told, len(threads))
    finally:
        for run in runs:
            run.interrupt()
        while any(thread.is_alive() for thread in threads):
            try:
                told.get(timeout=0.02)  # whoever waits to tell a sample must get rid of it
            except queue.Empty:
                continue


def _samples(
    told: "queue.Queue[tuple[str, Sample | BaseException | None]]", running: int
) -> Iterator[tuple[str, Sample]]:
    while running:
        try:
            component, said = told.get(timeout=0.5)  # in pieces: on Windows an endless wait does not hear a Ctrl-C
        except queue.Empty:
            continue
        if isinstance(said, BaseException):
            raise said
        if said is None:
            running -= 1
        else:
            yield component, said


def _drive(run: ComponentRun, told: "queue.Queue[tuple[str, Sample | BaseException | None]]") -> None:
    """In a thread: read one component's samples, and close it."""
    last: BaseException | None = None
    try:
        with run:
            for sample in run:
                told.put((run.component, sample))
    except BaseException as error:  # noqa: BLE001 - raised again, to who reads the samples
        last = error
    told.put((run.component, last))
