"""Plan files: written with what a plan is made of; read by making the plan again."""

from dataclasses import replace

from rarms_iac.app.files import read_input_file, write_file
from rarms_iac.app.plan_key import plan_key
from rarms_iac.app.use_case_errors import Outcome, UseCaseError
from rarms_iac.applying.make_plan import NotMadeAgain, make_again
from rarms_iac.model.commands import PLAN_OUT
from rarms_iac.model.plan import Plan
from rarms_iac.model.wording import quoted
from rarms_iac.storage.plan_file import (
    MAX_BYTES,
    PlanFileError,
    another_plan,
    decode_plan_file,
    has_signed_file,
    signed,
    write_plan,
)


def write_plan_file(path: str, plan: Plan) -> None:
    """Write what a plan is made of, for `read_plan_file`.

    Args:
        plan: as `planning.plan` made it.

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
            raise another_plan(file, f"it makes plan {plan.id} here, and was written for plan {quoted(file.id)}")
    except PlanFileError as error:
        finding = error.finding.at(None, "{file}: {reason}.", error.advice, file=path, reason=error.message)
        raise UseCaseError(Outcome.REFUSED, [finding]) from error
    plan, key = replace(plan, signature=file.signature), plan_key()
    return signed(plan, key) if key is not None and has_signed_file(plan, key) else plan
