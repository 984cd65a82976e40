"""Looking at the machine: state, last run and holder, in one answer."""

from collections.abc import Callable
from pathlib import Path
from typing import Any

from rarms_iac.app.wiring import open_host
from rarms_iac.model.host import Host
from rarms_iac.providers.interface import HostError, StepwiseHost
from rarms_iac.providers.robot import Look, problem_of
from rarms_iac.robot.caller import Caller
from rarms_iac.storage.codec import Json, encode


def look(host: Host, _job: Json, _caller: Caller) -> Json:
    """Look at the machine and the last run on it, for no application: the caller knows for which."""
    live = open_host(host, Path(), "")
    assert isinstance(live, StepwiseHost), "a Linux host of this machine is changed step by step"
    holder, observed = live.holder(), _tried(lambda: live.examined(""))
    return encode(Look(observed=observed, last_run=_tried(live.journal), holder=holder or live.holder()))


def _tried(question: Callable[[], Any]) -> Any:
    try:
        return question()
    except HostError as error:
        return problem_of(error)


COMMANDS = {"look": look}
