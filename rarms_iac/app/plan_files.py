"""Plan files: written with what a plan is made of; read by making the plan again. And the key of their signature.

The key is in `RARMS_PLAN_KEY`, or in the file that `RARMS_PLAN_KEY_FILE` names.
"""

import os
import stat
import sys
from collections.abc import Mapping
from dataclasses import replace
from pathlib import Path

from rarms_iac.app.files import read_input_file, write_file
from rarms_iac.app.use_case_errors import Outcome, RequestError, UseCaseError
from rarms_iac.applying.make_plan import NotMadeAgain, make_again
from rarms_iac.model.commands import PLAN_OUT
from rarms_iac.model.plan import Plan
from rarms_iac.storage.plan_file import (
    MAX_BYTES,
    PlanFileError,
    another_plan,
    decode_plan_file,
    has_signed_file,
    signed,
    write_plan,
)
from rarms_iac.storage.reading import read_file
from rarms_iac.texts.messages import quoted, reason_of

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
            "Make a key with `openssl rand -hex 32`.",
        )
    return key


def _key_in(name: str) -> bytes:
    try:
        status, key = Path(name).stat(), read_file(name, _MAX_BYTES)
    except (OSError, ValueError) as error:
        reason = reason_of(error)
        raise RequestError(
            f"The key file {name} of {FILE_VARIABLE} cannot be read: {reason}.",
            f"Set {FILE_VARIABLE} to the path of the key file.",
        ) from error
    if sys.platform == "win32":
        return key
    if status.st_uid not in (0, os.geteuid()):
        raise RequestError(
            f"{name}, the file in {FILE_VARIABLE}, belongs to another user (uid {status.st_uid}).",
            f"Run `chown {os.geteuid()} {name}`.",
        )
    if status.st_mode & _OTHERS:
        raise RequestError(
            f"Users other than the owner can read or write {name}, the file in {FILE_VARIABLE}.",
            f"Run `chmod 600 {name}`.",
        )
    return key


def write_plan_file(path: str, plan: Plan) -> None:
    """Write what a plan is made of, for `read_plan_file`.

    Raises:
        UseCaseError: it cannot be written (failed).
    """
    write_file(path, write_plan(plan))


def read_plan_file(path: str) -> Plan:
    """Read a plan file, and make its plan again (`plan_in`).

    Args:
        path: as the user gave it; `-` is standard input.

    Raises:
        UseCaseError: the file is not there (missing), cannot be read (failed), or does not make its plan (refused).
    """
    return plan_in(path, read_input_file(path, MAX_BYTES, PLAN_OUT))


def plan_in(path: str, data: bytes) -> Plan:
    """Make the plan of a file again, from what the file holds.

    Returns:
        The plan that was written, with the same id. Where a key is set that the file is signed with, its parts are
            signed, too.

    Raises:
        UseCaseError: it is not a plan file of this version, or makes another plan than it was written for (refused).
    """
    try:
        file = decode_plan_file(data)
        try:
            plan = make_again(file.inputs)
        except NotMadeAgain as error:
            raise another_plan(file, error.message) from error
        if plan.id != file.id:
            raise another_plan(
                file, f"it was written for plan {quoted(file.id)}, but its inputs give plan {plan.id} here"
            )
    except PlanFileError as error:
        finding = error.finding.at(None, "{file}: {reason}.", error.advice, file=path, reason=error.message)
        raise UseCaseError(Outcome.REFUSED, [finding]) from error
    plan, key = replace(plan, signature=file.signature), plan_key()
    return signed(plan, key) if key is not None and has_signed_file(plan, key) else plan
