"""Breaks a command of a robot at one of its lines: rarms there, rarms here, or the connection between them.

The robot's own Python does it, just before it sends the line, so that no time has to be guessed.
"""

import json
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

MODULE = """\
import json, os, signal
WHERE, write, answer = {where!r}, os.write, {{}}

def break_or_write(descriptor, data):
    line = bytes(data)
    if line == b"rarms: ready\\n" and os.path.exists(WHERE):
        with open(WHERE) as file:
            answer[descriptor] = json.load(file)
    if descriptor in answer and answer[descriptor][0].encode() in line[:200]:
        answer[descriptor][1] -= 1
        if answer[descriptor][1] == 0:
            process = answer[descriptor][2]
            os.remove(WHERE)
            os.kill({{"there": os.getpid(), "connection": os.getppid()}}.get(process, process), signal.SIGKILL)
    return write(descriptor, data)

os.write = break_or_write
"""


@contextmanager
def breakable(packages: Path, where: Path) -> Iterator[None]:
    """Have a robot's Python break its commands as a file says.

    Args:
        packages: of the robot's rarms.
    """
    module, start = packages / "break_at.py", packages / "break_at.pth"
    module.write_text(MODULE.format(where=str(where)), encoding="utf-8")
    start.write_text("import break_at\n", encoding="utf-8")
    try:
        yield
    finally:
        start.unlink()
        module.unlink()


def break_at(where: Path, at: str, nth: int, process: int | str) -> None:
    """Have the next command break at the nth line with this text.

    Args:
        where: as of `breakable`.
        at: a part of the line.
        nth: among such lines.
        process: that is killed; `there`: the robot's; `connection`: what leads to it.
    """
    new = where.with_suffix(".new")
    new.write_text(json.dumps([at, nth, process]), encoding="utf-8")
    new.replace(where)
