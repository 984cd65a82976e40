"""The manifest that `rarms init` writes."""

import re

from rarms_iac.manifest.edit.values import set_value
from rarms_iac.model.names import WINDOWS_DEVICES
from rarms_iac.storage.shipped import shipped_text

_LONGEST = 63
_WITHOUT_A_NAME = "my-application"


def initial_manifest(name: str) -> str:
    """A commented manifest of an application of this name, which validates and plans on a simulated host."""
    template = shipped_text("templates/init/rarms.yaml")
    return set_value(template, ("application", "name"), name)


def tutorial_manifest() -> str:
    """The manifest of docs/tutorial.md: three components that need more than there is, until two of them share."""
    return shipped_text("templates/init/tutorial.yaml")


def name_from(folder: str) -> str:
    """The name of a folder as an application may be called: `My Robot (2)` -> `my-robot-2`."""
    name = re.sub(r"[^a-z0-9]+", "-", folder.lower()).strip("-")[:_LONGEST].strip("-")
    return _WITHOUT_A_NAME if name == "" or name in WINDOWS_DEVICES else name
