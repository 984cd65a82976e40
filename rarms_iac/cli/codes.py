"""The exit codes: what a script or a pipeline may rely on."""

from enum import IntEnum

from rarms_iac.app.errors import Outcome


class ExitCode(IntEnum):
    """How a command ended."""

    DONE = 0  # done, nothing to do, or warnings only
    FAILED = 1  # the tool or the host failed
    FOUND = 2  # plan: changes; validate: errors; fmt --check: not formatted; drift: the host changed
    REFUSED = 3  # host moved, busy or locked; plan stale, edited or used; another run unfinished
    NO = 4  # errors in the manifest, does not fit
    NOT_APPLIED = 5  # drift: only not applied yet
    USAGE = 64
    INTERRUPTED = 130  # Ctrl-C; can be resumed
    TERMINATED = 143


CODES = {
    Outcome.FAILED: ExitCode.FAILED,
    Outcome.REFUSED: ExitCode.REFUSED,
    Outcome.NEGATIVE: ExitCode.NO,
    Outcome.INTERRUPTED: ExitCode.INTERRUPTED,
}
"""How a command ends whose use case ended without an answer."""
