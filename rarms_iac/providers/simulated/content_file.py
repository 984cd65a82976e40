"""The file that holds the content of a simulated host: one JSON object of `format`, `checksum` and `content`.

The checksum is the SHA-256 of the text of `content`. A file that is not exactly as it was written is damaged, and is
never taken for something else. Pure.
"""

import hashlib
import re
import uuid
from functools import lru_cache

from rarms_iac.model.state import RunState
from rarms_iac.model.wording import quoted
from rarms_iac.providers.simulated.content import Content, SimulatedMachine
from rarms_iac.providers.simulated.refusals import out_of_range
from rarms_iac.storage.codec import NotDecodable, decode
from rarms_iac.storage.json_text import canonical, parse_json

FORMAT = "rarms-simulated-host/1"

_HEAD = re.compile(r'\{"format":"(?P<format>[^"\\]{1,60})","checksum":"(?P<checksum>[0-9a-f]{64})","content":')

_TAIL = "}\n"


def write_content(content: Content) -> bytes:
    """Return the file that holds this content."""
    machines = ",".join(
        f'"{machine}":{_machine_text(content.machines[machine])}' for machine in sorted(content.machines)
    )
    others = {name: canonical(getattr(content, name)) for name in ("id", "made", "struck", "disks")}
    registries = ",".join(
        f'"{registry}":{canonical(content.registries[registry])}' for registry in sorted(content.registries)
    )
    members = {**others, "machines": f"{{{machines}}}", "registries": f"{{{registries}}}"}
    inside = ",".join(f'"{name}":{member}' for name, member in sorted(members.items()))
    text = f"{{{inside}}}"
    return f'{{"format":"{FORMAT}","checksum":"{_checksum(text)}","content":{text}{_TAIL}'.encode("ascii")


@lru_cache(maxsize=10_000)  # one operation changes one machine: the others need not be written anew
def _machine_text(machine: SimulatedMachine) -> str:
    return canonical(machine)


def read_content(data: bytes) -> Content:
    """Return the content of the file.

    Raises:
        NotDecodable: it is not as it was written, is of another format, or holds what cannot be.
    """
    try:
        file = data.decode("ascii").replace("\r\n", "\n")
    except UnicodeDecodeError:
        raise NotDecodable("", "it is not the text that rarms wrote") from None
    head = _HEAD.match(file)
    if head is None or not file.endswith(_TAIL):
        raise NotDecodable("", "it is cut off, or was not written by rarms")
    if head["format"] != FORMAT:
        raise NotDecodable("format", f"this rarms reads {FORMAT}, not {head['format']}")
    text = file[head.end() : -len(_TAIL)]
    if head["checksum"] != _checksum(text):
        raise NotDecodable("checksum", "it does not fit the content")
    content = decode(Content, parse_json(text))
    _check(content)
    return content


def _checksum(text: str) -> str:
    return hashlib.sha256(text.encode("ascii")).hexdigest()


def _check(content: Content) -> None:
    """Refuse what no series of operations could have made."""
    _check_id("id", content.id)
    for machine in content.machines.values():
        path = f"machines.{machine.id}"
        _check_id(path, machine.id)
        if content.machines.get(machine.id) is not machine:
            raise NotDecodable(path, "the machine is filed under another id")
        if problem := out_of_range(machine.settings):
            raise NotDecodable(path, problem)
        if machine.settings.running is not (machine.state is RunState.RUNNING):
            raise NotDecodable(path, "it is said to be running and not running")
    if unknown := content.registries.keys() - content.machines.keys() - {""}:
        raise NotDecodable(f"registries.{min(unknown)}", "there is no such machine")
    if content.made < len(content.machines):
        raise NotDecodable("made", "a count is too small")


def _check_id(path: str, text: str) -> None:
    try:
        sound = str(uuid.UUID(text)) == text
    except ValueError:
        sound = False
    if not sound:
        raise NotDecodable(path, f"{quoted(text)} is no id")
