"""Small wheels for `install_there`: a pip that unpacks wheels, and a rarms that knows its version and its journals.

The program that installs them is the real one; so are the virtual environment, the links and the processes.
"""

import hashlib
import io
import zipfile

from rarms_iac.app.install_wheels import Wheel

PIP = """\
import sys, sysconfig, zipfile
for wheel in (word for word in sys.argv if word.endswith(".whl")):
    zipfile.ZipFile(wheel).extractall(sysconfig.get_path("purelib"))
"""
FINISH = """\
import json, pathlib, sys
for path in pathlib.Path({state!r}).glob("*/journal.jsonl"):
    started = json.loads(path.read_bytes().splitlines()[0])
    if started["rarms"] == {version!r}:
        if started["plan"] == "stuck":
            sys.exit("RARMS186: the disk says no")
        with path.open("a") as file:
            file.write(json.dumps({{"kind": "run_closed", "by": {version!r}}}) + "\\n")
"""


def wheels_of(version: str, state: str, extra_bytes: int = 0) -> tuple[Wheel, ...]:
    """Make the wheels of one version.

    Args:
        state: the robot's folder of journals.
        extra_bytes: of a file of no use.
    """
    rarms = {
        "rarms_iac/__init__.py": f"VERSION = {version!r}\n",
        "rarms_iac/__main__.py": f"print({version!r})\n",
        "rarms_iac/robot/__init__.py": "",
        "rarms_iac/data": "0" * extra_bytes,
        "rarms_iac/robot/finish.py": FINISH.format(state=state, version=version),
    }
    return _wheel("pip-0-py3-none-any.whl", {"pip/__init__.py": "", "pip/__main__.py": PIP}), _wheel(
        f"rarms_iac-{version}-py3-none-any.whl", rarms
    )


def _wheel(name: str, files: dict[str, str]) -> Wheel:
    target = io.BytesIO()
    with zipfile.ZipFile(target, "w") as archive:
        for path, text in files.items():
            archive.writestr(zipfile.ZipInfo(path), text)
    content = target.getvalue()
    return Wheel(name=name, digest=hashlib.sha256(content).hexdigest(), content=content)
