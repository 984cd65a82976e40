"""The key that plans are signed with: `RARMS_PLAN_KEY`, `RARMS_PLAN_KEY_FILE`."""

import os
import stat
import sys
from collections.abc import Mapping
from pathlib import Path

from rarms_iac.app.use_case_errors import RequestError
from rarms_iac.model.wording import reason_of
from rarms_iac.storage.reading import read_file

VARIABLE, FILE_VARIABLE = "RARMS_PLAN_KEY", "RARMS_PLAN_KEY_FILE"
LEAST_BYTES = 16
_MAX_BYTES = 4096
_OTHERS = stat.S_IRWXG | stat.S_IRWXO


def plan_key(environment: Mapping[str, str] = os.environ) -> bytes | None:
    """Return the key that plans must be signed with.

    Args:
        environment: holds the key or the name of its file; blanks around the key do not count.

    Returns:
        The key; None: none is set, and no plan needs a signature.

    Raises:
        RequestError: both are set, the key has fewer than `LEAST_BYTES`, or its file cannot be read, is not its
            owner's alone, or is another user's (root's may be).
    """
    if VARIABLE in environment and FILE_VARIABLE in environment:
        raise RequestError(f"{VARIABLE} and {FILE_VARIABLE} are both set.", "Set one of them.")
    if FILE_VARIABLE in environment:
        key, origin = _key_in(environment[FILE_VARIABLE]), FILE_VARIABLE
    elif VARIABLE in environment:
        key, origin = environment[VARIABLE].encode("utf-8", "surrogateescape"), VARIABLE
    else:
        return None
    key = key.strip()
    if len(key) < LEAST_BYTES:
        raise RequestError(
            f"The key of {origin} has {len(key)} bytes; at least {LEAST_BYTES} are needed.",
            "Make one with `openssl rand -hex 32`.",
        )
    return key


def _key_in(name: str) -> bytes:
    try:
        status, key = Path(name).stat(), read_file(name, _MAX_BYTES)
    except (OSError, ValueError) as error:
        reason = reason_of(error)
        raise RequestError(f"{FILE_VARIABLE} names {name}: {reason}.", "Name a file that holds the key.") from error
    if sys.platform == "win32":
        return key
    if status.st_uid not in (0, os.geteuid()):
        raise RequestError(
            f"{FILE_VARIABLE} names {name}, which belongs to another user (uid {status.st_uid}).",
            f"Run `chown {os.geteuid()} {name}`.",
        )
    if status.st_mode & _OTHERS:
        raise RequestError(
            f"{FILE_VARIABLE} names {name}, which others than its owner may use.", f"Run `chmod 600 {name}`."
        )
    return key
