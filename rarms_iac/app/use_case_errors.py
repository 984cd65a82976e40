"""Errors that end a use case without an answer: which kind of end it is, and the findings that say why."""

from collections.abc import Sequence
from enum import Enum

from rarms_iac.model.commands import Wording
from rarms_iac.model.diagnostics import Diagnostic, Severity, Sources, first_of_each_kind


class Outcome(Enum):
    """Why there is no answer."""

    FAILED = "failed"  # rarms or a host failed
    REFUSED = "refused"  # a host moved, is busy or held; a plan is stale, edited or used; a run is unfinished
    NEGATIVE = "negative"  # the answer is no: errors in the manifest, nothing fits, a threshold is out of reach
    MISSING = "missing"  # a file that was named is not there
    INTERRUPTED = "interrupted"  # a person or the system asked for an end


class UseCaseError(Exception):
    """A use case ended without its answer; its text is what the errors among the findings say, in short.

    Attributes:
        outcome: what kind of end it is; the command line makes an exit code of it.
        findings: the reasons, the first of each kind; none only if the user interrupted the work of a robot.
        sources: the manifest's files that the reasons point into, by the names that places use.
    """

    def __init__(
        self,
        outcome: Outcome,
        diagnostics: Sequence[Diagnostic],
        sources: Sources | None = None,
    ) -> None:
        errors = [finding for finding in diagnostics if finding.severity is Severity.ERROR]
        super().__init__("; ".join(dict.fromkeys(finding.summary for finding in errors or diagnostics)))
        self.outcome = outcome
        self.findings = first_of_each_kind(diagnostics)
        self.sources = sources or {}


class RequestError(ValueError):
    """What was asked cannot be done as it was asked: an unknown name, or values that contradict each other.

    Nothing was done.

    Attributes:
        message: a whole sentence for people.
        advice: what to do instead, with the commands that help; empty: the message says enough.
    """

    def __init__(self, message: str, advice: Wording = "") -> None:
        super().__init__(message)
        self.message = message
        self.advice = advice
