"""A plan's id, its signature and that of its scripts, and its file, which holds what the plan is made of.

The id is a digest of what the plan does, without the scripts, which carry the id themselves, and without the paths of
files, which depend on where it is made. `applying.make_plan.make_again` makes the plan of a file's inputs. A script is
signed by a remark at its end, over its text, so that a host's journal carries it with the script. A script holds the
digest of the undo script next to it, so that one is signed first.
"""

import hashlib
import hmac
import re
from collections.abc import Iterator, Mapping
from dataclasses import dataclass, replace
from functools import cache
from importlib import metadata
from typing import Any, Literal, cast

from rarms_iac.model.commands import PLAN_OUT, Wording, prose
from rarms_iac.model.plan import HostPlan, HostSteps, Plan, PlanInputs, RunIdentity
from rarms_iac.model.version import __version__
from rarms_iac.storage.codec import Json, NotDecodable, decode, encode
from rarms_iac.storage.json_text import canonical, digest, digest_of_texts, parse_json, readable_json, short
from rarms_iac.texts.findings import Finding
from rarms_iac.texts.messages import in_a_row, quoted

FORMAT = "rarms-plan/3"
MAX_BYTES = 64 * 2**20

ANOTHER_PLAN = Finding.error("RARMS180", "The plan file does not match its plan")
UNREADABLE = Finding.error("RARMS188", "This is not a plan file")
_WITH_THIS_VERSION = prose("Make the plan again with this version of rarms: ", PLAN_OUT, ".")


class PlanFileError(Exception):
    """The file is not a plan that may be applied; `message` says what it is instead, `advice` what to do."""

    def __init__(self, message: str, advice: Wording, finding: Finding = UNREADABLE) -> None:
        super().__init__(message)
        self.message = message
        self.advice = advice
        self.finding = finding


@dataclass(frozen=True, slots=True, kw_only=True)
class PlanFile:
    """The content of a plan file."""

    format_version: Literal["rarms-plan/3"] = "rarms-plan/3"
    id: str  # of the plan that the inputs make
    signature: str = ""  # HMAC-SHA256 of all the rest, in hex; empty: no key was set
    inputs: PlanInputs


@cache
def versions() -> Mapping[str, str]:
    """Return the versions of rarms and of what it solves with; of what is not installed, an empty text."""
    return {"rarms": __version__, "highspy": _version_of("highspy"), "networkx": _version_of("networkx")}


def _version_of(package: str) -> str:
    try:
        return metadata.version(package)
    except metadata.PackageNotFoundError:
        return ""


def identified(plan: Plan) -> Plan:
    """Return the plan, complete but for the scripts that carry its id, with its id."""
    return replace(plan, id=plan_id(plan))


def plan_id(plan: Plan) -> str:
    """Return 12 hex digits of what the plan does: the same from any folder that `rarms plan` is called in.

    Scripts are left out, which carry the id, and all that names files as they are seen from there: the paths of the
    manifest and its overlays, the files of places, and the findings, whose advice repeats the options of the command.
    The recorded texts count where they differ from the manifest's own, which has secrets or was edited since.
    """
    hosts = tuple(_bare(host) for host in plan.hosts)
    document = cast("dict[str, Any]", encode(replace(plan, id="", manifest="", findings=(), accepted=(), hosts=hosts)))
    for name in ("overlays", "inputs", "signature"):
        del document[name]
    if (texts := digest_of_texts(["\n".join(text.lines) for text in plan.inputs.texts])) != plan.manifest_digest:
        document["texts"] = texts
    for place in _places_in(document["hosts"]):
        if place is not None:
            del place["file"]
    return short(digest(document))


def run_id(run: RunIdentity, on: HostSteps) -> str:
    """Return 12 hex digits of a run of one host that has no plan."""
    return short(digest([encode(replace(run, id="")), encode(on)]))


def _bare(host: HostPlan) -> HostPlan:
    """Return a host's part of a plan without its signature, and without scripts, which follow from it."""
    return replace(host, scripts={}, signature="")


def signed(plan: Plan, key: bytes) -> Plan:
    """Sign a plan's file, and for journals each host's part, over what it does, and each script, over its text.

    Args:
        plan: with its id, which stays the same.
        key: of those who may write plans that are applied.
    """
    hosts = tuple(
        replace(
            host,
            signature=signature_of(plan.id, plan.application, host, key),
            scripts=signed_scripts(host.scripts, key),
        )
        for host in plan.hosts
    )
    return replace(plan, signature=_file_signature(plan, key), hosts=hosts)


def _file_signature(plan: Plan, key: bytes) -> str:
    text = canonical(encode(PlanFile(id=plan.id, inputs=plan.inputs)))
    return hmac.new(key, text.encode("ascii"), hashlib.sha256).hexdigest()


def has_signed_file(plan: Plan, key: bytes) -> bool:
    """Tell whether the signature of a plan's file fits the key; in a time that says nothing of it."""
    return hmac.compare_digest(plan.signature, _file_signature(plan, key))


def signature_of(plan: str, application: str, host: HostPlan, key: bytes) -> str:
    """Return the signature of a host's part of a plan."""
    text = canonical([plan, application, encode(_bare(host))])
    return hmac.new(key, text.encode("ascii"), hashlib.sha256).hexdigest()


def is_signed(plan: str, application: str, host: HostPlan, key: bytes) -> bool:
    """Tell whether the signature of a host's part fits the key; in a time that says nothing of it."""
    return hmac.compare_digest(host.signature, signature_of(plan, application, host, key))


def _places_in(hosts: list[Any]) -> Iterator[dict[str, Json] | None]:
    """Yield the places of the manifest in the encoded parts of a plan."""
    for host in hosts:
        changes = [*host["changes"], *(held["change"] for held in host["held_back"])]
        yield from (change["reason"]["place"] for change in changes)
        yield from (step["place"] for step in (*host["steps"], *(host["guest_tasks"] or ())))


def write_plan(plan: Plan) -> bytes:
    """Return the file of a plan with its id: JSON that a person can read and git can compare, UTF-8 with LF."""
    return readable_json(encode(PlanFile(id=plan.id, inputs=plan.inputs, signature=plan.signature)))


def decode_plan_file(data: bytes) -> PlanFile:
    """Return the content of a plan file.

    Raises:
        PlanFileError: it is not one, or another version of rarms wrote it.
    """
    advice = prose("Give a file written by ", PLAN_OUT, ".")
    try:
        document = parse_json(data.decode("utf-8-sig"))
    except ValueError as error:
        raise PlanFileError("it is not a plan file: not JSON", advice) from error
    if not isinstance(document, dict) or "format_version" not in document:
        raise PlanFileError("it is not a plan file", advice)
    if document["format_version"] != FORMAT:
        raise PlanFileError(
            f"its format is {quoted(document['format_version'])}; this rarms reads {FORMAT}",
            _WITH_THIS_VERSION,
        )
    try:
        file = decode(PlanFile, document)
    except NotDecodable as error:
        raise PlanFileError(str(error), _WITH_THIS_VERSION) from error
    own = file.inputs.versions.get("rarms", "")
    if own != __version__:
        raise PlanFileError(f"it was made by rarms {quoted(own)}; this is rarms {__version__}", _WITH_THIS_VERSION)
    return file


def another_plan(file: PlanFile, message: str) -> PlanFileError:
    """Return the error for a file that does not make its plan, with the versions that differ from those here."""
    there, here = file.inputs.versions, versions()
    differing = [
        f"{name} {quoted(there.get(name, ''))} (here: {quoted(here.get(name, ''))})"
        for name in sorted(there.keys() | here.keys())
        if there.get(name) != here.get(name)
    ]
    made_with = f"it was made with {in_a_row(differing)}" if differing else "it was edited"
    return PlanFileError(f"{message}: {made_with}", prose("Make the plan again: ", PLAN_OUT, "."), ANOTHER_PLAN)


_REMARK = re.compile(r"# rarms key signature ([0-9a-f]{64})\r\n\Z")
_UNDO = ".undo.ps1"


def signed_scripts(scripts: Mapping[str, str], key: bytes) -> dict[str, str]:
    """Sign the scripts of a host.

    Args:
        scripts: by file name, each unsigned ASCII with CRLF.
        key: of those who may write plans that are applied.

    Returns:
        The same names; each script names the digest of its signed undo script.
    """
    undo = {name: _signed(text, key) for name, text in scripts.items() if name.endswith(_UNDO)}
    rest = {name: _naming(name, text, scripts, undo) for name, text in scripts.items() if name not in undo}
    return {name: undo[name] if name in undo else _signed(rest[name], key) for name in scripts}


def is_signed_script(text: str, key: bytes) -> bool:
    """Tell whether a script has a signature that fits the key.

    Args:
        text: of the script, without what Windows adds to sign it.
    """
    found = _REMARK.search(text)
    return found is not None and hmac.compare_digest(found[1], _signature(text[: found.start()], key))


def _naming(name: str, text: str, before: Mapping[str, str], after: Mapping[str, str]) -> str:
    """Return the script with the digest of its undo script as that is now."""
    undo = f"{name.removesuffix('.ps1')}{_UNDO}"
    return text.replace(_digest(before[undo]), _digest(after[undo])) if undo in before and undo in after else text


def _digest(text: str) -> str:
    return hashlib.sha256(text.encode("utf-8", "surrogatepass")).hexdigest()


def _signed(text: str, key: bytes) -> str:
    return f"{text}# rarms key signature {_signature(text, key)}\r\n"


def _signature(text: str, key: bytes) -> str:
    return hmac.new(key, b"script\0" + text.encode("utf-8", "surrogatepass"), hashlib.sha256).hexdigest()
