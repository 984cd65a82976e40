"""How a caller takes part while a use case works: it hears what goes on, may end it, and is asked; by default not."""

from collections.abc import Callable, Iterator, Sequence
from contextlib import AbstractContextManager, contextmanager
from dataclasses import dataclass
from typing import Protocol

from rarms_iac.applying.run_report import RunReporter
from rarms_iac.measuring.reporter import MeasuringReporter
from rarms_iac.model.diagnostics import Diagnostic, Sources


class StopSignal(Protocol):
    """Says whether the work is to end."""

    def should_stop(self) -> bool:
        """Whether the work ends at the next safe place; asked between steps and settings, so it must be quick.

        Returns:
            True from the request on; it is not taken back.
        """

    def gently(self) -> AbstractContextManager[None]:
        """Inside, a host is being changed: a request to stop must wait for `should_stop` to be asked.

        Returns:
            A context to enter around the change.
        """


class NeverStop:
    """No end is asked for."""

    def should_stop(self) -> bool:
        """Return False."""
        return False

    @contextmanager
    def gently(self) -> Iterator[None]:
        """Nothing is there to be held back.

        Yields:
            Once, with nothing.
        """
        yield


class Reporter(Protocol):
    """Hears what goes on. It must not raise, and nothing waits for an answer of it."""

    @property
    def steps(self) -> RunReporter:
        """Hears of each step of an apply, an undo, or a run that is finished."""

    @property
    def settings(self) -> MeasuringReporter:
        """Hears of each setting that is measured."""

    def message(self, text: str) -> None:
        """One or more whole sentences about what was done, without a line end.

        Args:
            text: for a person; not wrapped yet.
        """

    def findings(self, diagnostics: Sequence[Diagnostic], sources: Sources | None = None) -> None:
        """Findings that do not end the work.

        Args:
            diagnostics: in any order; may be empty.
            sources: the files that they point into.
        """


class SilentAppReporter:
    """A `Reporter` that keeps everything to itself."""

    steps: RunReporter = RunReporter()
    settings: MeasuringReporter = MeasuringReporter()

    def message(self, text: str) -> None:
        pass

    def findings(self, diagnostics: Sequence[Diagnostic], sources: Sources | None = None) -> None:
        pass


StopConsent = Callable[[str, tuple[str, ...]], bool]
"""Whether these partitions of a host may be stopped while it is measured: asked once a host, before the first."""


def never_consents(_host: str, _partitions: tuple[str, ...]) -> bool:
    """Stop nothing: the measurement is refused."""
    return False


def always_consents(_host: str, _partitions: tuple[str, ...]) -> bool:
    """Stop what runs, as the options ask for."""
    return True


@dataclass(frozen=True, slots=True, kw_only=True)
class Control:
    """The caller's part in a use case that changes a host, or measures on it."""

    reporter: Reporter = SilentAppReporter()
    stop: StopSignal = NeverStop()  # asked after each step, between settings and while samples come
    consents: StopConsent = never_consents  # to measure; they start again afterwards, however it ends


UNATTENDED = Control()
"""No report, no early end, and no partition is stopped."""
