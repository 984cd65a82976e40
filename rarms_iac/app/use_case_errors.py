"""Errors that end a use case without an answer, and the findings that any use case may end with."""

from collections.abc import Sequence
from enum import Enum

from rarms_iac.model.commands import PLAN, Wording, command, prose, sentences
from rarms_iac.model.diagnostics import Diagnostic, Severity, Sources
from rarms_iac.storage.disk import advice_on
from rarms_iac.texts.findings import NOT_DONE, NOT_READ, NOTHING_CHANGED, Finding, first_of_each_kind
from rarms_iac.texts.messages import reason_of


class Outcome(Enum):
    """The reason why a command has no answer."""

    FAILED = "failed"  # rarms or a host failed
    REFUSED = "refused"  # a host moved, is busy or held; a plan is stale, edited or used; a run is unfinished
    NEGATIVE = "negative"  # errors in the manifest, nothing fits, a threshold cannot be met
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
    """A request that cannot be met as it is: an unknown name, or values that contradict each other.

    Nothing was done.

    Attributes:
        message: a whole sentence for people.
        advice: what to do instead, with the commands that help; empty: the message says enough.
    """

    def __init__(self, message: str, advice: Wording = "") -> None:
        super().__init__(message)
        self.message = message
        self.advice = advice


NOT_WRITTEN = Finding.error("RARMS177", "A file could not be written")

SYSTEM_REFUSED = Finding.error("RARMS178", "The operating system refused a request")
BUG = Finding.error("RARMS199", "This is a bug in rarms")


def bug_finding(error: BaseException) -> Diagnostic:
    """Make the finding for an unforeseen exception.

    Args:
        error: the exception; the first 300 characters of its text are shown.

    Returns:
        A finding with the exception's kind and place, and where to report it.
    """
    reason, name = reason_of(error)[:300], type(error).__name__
    return BUG.at(
        None,
        "{exception}" if reason == name else "{exception}: {reason}",
        "Run the same command with --debug, and report the bug with the trace.",
        exception=name,
        reason=reason,
    )


def usage_finding(message: str, advice: Wording, verb: str) -> Diagnostic:
    """Make the finding for words that do not fit a command, for a program that reads findings.

    Args:
        advice: what to do instead; empty: the command's help says it.
        verb: the command whose `--help` is advised; empty: none was named.

    Returns:
        A finding without a place.
    """
    takes = prose(command(verb, help=True), " lists its options.")
    commands = prose(command("", help=True), " lists the commands.")
    return NOT_DONE.at(None, "{reason}", sentences(advice, takes if verb else commands), command=verb, reason=message)


def system_finding(error: OSError) -> Diagnostic:
    """Make the finding for a call that the operating system refused, where nothing closer to the call explains that.

    Args:
        error: its file name is shown, if it has one.

    Returns:
        A finding with the file's name, where the error has one.
    """
    path = f"{error.filename}: " if error.filename else ""
    return SYSTEM_REFUSED.at(
        None,
        "{_path}{reason}.",
        advice_on(error, "Check the path, its permissions and the free space on the disk; --debug shows the trace."),
        file=str(error.filename or ""),
        reason=reason_of(error),
        _path=path,
    )


def conflict_finding(path: str) -> Diagnostic:
    """Make the finding for a file that exists already and is not replaced.

    Returns:
        A finding that asks for another file or folder.
    """
    return NOT_WRITTEN.at(
        None,
        "{file} already exists and was not changed.",
        "Give another name, or move that file away first.",
        file=path,
    )


def write_finding(path: str, error: OSError) -> Diagnostic:
    """Make the finding for a file that could not be written.

    Returns:
        A finding with the system's own words.
    """
    advice = "Give a regular file in an existing folder that you may write to. Links are not allowed."
    return NOT_WRITTEN.at(None, "{file}: {reason}.", advice, file=path, reason=reason_of(error))


def read_finding(path: str, message: str, advice: Wording) -> Diagnostic:
    """Return the finding for a file that could not be read.

    Args:
        message: why, as the end of a sentence without a full stop.
        advice: what to do, as whole sentences.

    Returns:
        A finding with this message and advice.
    """
    return NOT_READ.at(None, "{file}: {reason}.", advice, file=path, reason=message)


def declined() -> Diagnostic:
    """Make the finding for a question that was not answered with yes.

    Returns:
        A finding without a place, as no line of the manifest is at fault.
    """
    return NOTHING_CHANGED.at(
        None,
        "The answer was not `yes`.",
        prose("Run the same command again and answer `yes`. ", PLAN, " only shows the changes."),
    )
