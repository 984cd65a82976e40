"""`rarms version`: what a report of a bug should say."""

import platform
import sys
from importlib.metadata import PackageNotFoundError, version

from rarms_iac import __version__
from rarms_iac.cli.codes import ExitCode
from rarms_iac.cli.options import json_option
from rarms_iac.cli.session import Session, rarms_command
from rarms_iac.views.as_json import as_json as to_json
from rarms_iac.views.output.common import VersionOutput

LIBRARIES = (
    "click",
    "google-re2",
    "jinja2",
    "networkx",
    "pydantic",
    "PyYAML",
    "rich",
    "tree-sitter-powershell",
    "xlsxwriter",
)


@rarms_command("version")
@json_option
def command(session: Session, *, as_json: bool) -> ExitCode:
    """Show the version of rarms, of Python, of the system and of the libraries."""
    facts = VersionOutput(
        rarms=__version__,
        python=platform.python_version(),
        system=f"{sys.platform} {platform.machine()}",
        libraries={name: _version(name) for name in LIBRARIES},
    )
    session.terminal.data(to_json(facts) if as_json else version_text(facts))
    return ExitCode.DONE


def version_text(facts: VersionOutput) -> str:
    """One line a thing."""
    own = {"rarms": facts.rarms, "python": facts.python, "system": facts.system}
    return "".join(f"{name} {message}\n" for name, message in {**own, **facts.libraries}.items())


def _version(library: str) -> str:
    try:
        return version(library)
    except PackageNotFoundError:
        return "not installed"
