"""A plan's id and seal, and its file.

The id is a digest of what the plan does, without the scripts, which carry the id themselves, and without the paths of
files, which depend on where it is made. The seal covers the whole file. Both are taken over the values, not over the
bytes: line ends that git changes do no harm, while one changed character of a script does.
"""

import hashlib
import hmac
from collections.abc import Iterator
from dataclasses import replace
from typing import Any, ClassVar, cast

from rarms_iac.model.commands import PLAN_OUT, Wording, prose
from rarms_iac.model.diagnostics import Finding
from rarms_iac.model.plan import HostPlan, Plan
from rarms_iac.model.plan_names import wrong_name_of_plan
from rarms_iac.model.version import __version__
from rarms_iac.model.wording import quoted
from rarms_iac.storage.codec import Json, NotDecodable, decode, encode
from rarms_iac.storage.digest import digest, short
from rarms_iac.storage.json_text import canonical, parse_json, readable_json
from rarms_iac.storage.script_signature import signed_scripts

FORMAT = "rarms-plan/2"
MAX_BYTES = 64 * 2**20


EDITED = Finding.error("RARMS180", "The plan file was edited")
UNREADABLE = Finding.error("RARMS188", "This is not a plan file")
PLAN_AGAIN = prose("Make the plan again: ", PLAN_OUT, ".")


class PlanFileError(Exception):
    """The file is not a plan that may be applied; `message` tells what it is instead, `advice` what to do."""

    finding: ClassVar[Finding]

    def __init__(self, message: str, advice: Wording) -> None:
        super().__init__(message)
        self.message = message
        self.advice = advice


class PlanUnreadable(PlanFileError):
    """It is no plan, or one of another version of rarms."""

    finding = UNREADABLE


class PlanEdited(PlanFileError):
    """It was changed after rarms wrote it."""

    finding = EDITED


def identified(plan: Plan) -> Plan:
    """The plan with its id.

    Args:
        plan: complete but for its id and the scripts that carry it.

    Returns:
        A copy.
    """
    return replace(plan, id=plan_id(plan))


def plan_id(plan: Plan) -> str:
    """12 hex digits of what the plan does: the same from any place in the file system `rarms plan` is called.

    Scripts are left out, which carry the id, what steps are made of again, and all that names files as they are seen
    from there: the paths of the manifest and its overlays, the files of places, and the findings, whose advice repeats
    the options of the command. The seal covers them.

    Args:
        plan: whose own id does not matter.

    Returns:
        Lower case.
    """
    hosts = tuple(_bare(host) for host in plan.hosts)
    bare = replace(plan, id="", manifest="", findings=(), accepted=(), hosts=hosts)
    document = cast("dict[str, Any]", encode(bare))
    del document["overlays"]
    for host in document["hosts"]:
        del host["basis"], host["signature"]
    for place in _places_in(document["hosts"]):
        if place is not None:
            del place["file"]
    if bare.placement is None:  # a plan that chose nothing says nothing of it
        del document["placement"]
    return short(digest(document))


def _bare(host: HostPlan) -> HostPlan:
    """What a host's part of a plan does: without scripts, which follow from it, and without what it is checked by."""
    return replace(host, scripts={}, basis=None, signature="")


def signed(plan: Plan, key: bytes) -> Plan:
    """Sign each host's part of a plan, over what the plan does, as its id, and each of its scripts, over its text.

    Args:
        plan: with its id.
        key: of those who may write plans that are applied.

    Returns:
        A copy; its id is the same.
    """
    return replace(
        plan,
        hosts=tuple(
            replace(
                host,
                signature=signature_of(plan.id, plan.application, host, key),
                scripts=signed_scripts(host.scripts, key),
            )
            for host in plan.hosts
        ),
    )


def signature_of(plan: str, application: str, host: HostPlan, key: bytes) -> str:
    """Work out the signature of a host's part of a plan.

    Args:
        plan: its id.
        application: whose plan it is.
        host: the part, as the plan or a journal has it.
        key: as of `signed`.

    Returns:
        64 hex digits.
    """
    text = canonical([plan, application, encode(_bare(host))])
    return hmac.new(key, text.encode("ascii"), hashlib.sha256).hexdigest()


def is_signed(plan: str, application: str, host: HostPlan, key: bytes) -> bool:
    """Tell whether the signature of a host's part fits the key; in a time that says nothing of it.

    Args:
        plan: as of `signature_of`.
        application: as there.
        host: as there.
        key: as there.
    """
    return hmac.compare_digest(host.signature, signature_of(plan, application, host, key))


def _places_in(hosts: list[Any]) -> Iterator[dict[str, Json] | None]:
    """Yield the places of the manifest in the encoded parts of a plan."""
    for host in hosts:
        changes = [*host["changes"], *(held["change"] for held in host["held_back"])]
        yield from (change["reason"]["place"] for change in changes)
        yield from (step["place"] for step in (*host["steps"], *(host["guest_tasks"] or ())))


def write_plan(plan: Plan) -> bytes:
    """The plan as a sealed file: JSON that a person can read and git can compare.

    Args:
        plan: with its id.

    Returns:
        UTF-8 with LF; the same plan has the same bytes.
    """
    document = cast("dict[str, Json]", encode(plan))
    sealed = {**document, "seal": digest(document)}
    return readable_json(sealed)


def read_plan(data: bytes) -> Plan:
    """The plan of a file.

    Args:
        data: all of the file.

    Returns:
        The plan, of which seal and id were checked.

    Raises:
        PlanUnreadable: not a plan file, or made by another version of rarms.
        PlanEdited: seal or id do not fit the content, or it has a name that no manifest can give.
    """
    document = _parsed(data)
    seal = document.pop("seal", None)
    if seal != digest(document):
        raise PlanEdited("its seal does not fit its content: it was edited", PLAN_AGAIN)
    if document.get("rarms_version") != __version__:
        raise PlanUnreadable(
            f"rarms {quoted(document.get('rarms_version'))} made it, and this is rarms {__version__}",
            prose("Make the plan again with this version of rarms: ", PLAN_OUT, "."),
        )
    try:
        plan = decode(Plan, document)
    except NotDecodable as error:
        raise PlanUnreadable(
            str(error), prose("Make the plan again with this version of rarms: ", PLAN_OUT, ".")
        ) from error
    if plan.id != plan_id(plan):
        raise PlanEdited("its id does not fit its content: it was edited", PLAN_AGAIN)
    if (name := wrong_name_of_plan(plan)) is not None:
        raise PlanEdited(f"no manifest can give the name {quoted(name)}: it was edited, and sealed anew", PLAN_AGAIN)
    return plan


def _parsed(data: bytes) -> dict[str, Json]:
    again = prose("Give a file that ", PLAN_OUT, " wrote.")
    try:
        document = parse_json(data.decode("utf-8-sig"))
    except ValueError as error:
        raise PlanUnreadable("it is not a plan file: not JSON", again) from error
    if not isinstance(document, dict) or "format_version" not in document:
        raise PlanUnreadable("it is not a plan file", again)
    if document["format_version"] != FORMAT:
        raise PlanUnreadable(
            f"it is of the format {quoted(document['format_version'])}, and this rarms reads {FORMAT}",
            prose("Make the plan again with this version of rarms: ", PLAN_OUT, "."),
        )
    return document
