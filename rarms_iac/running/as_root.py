"""Finds components that run as root although they need not."""

import os
import sys
from collections.abc import Iterable

from rarms_iac.model.diagnostics import Diagnostic, Places
from rarms_iac.model.run import AttachedContainer, AttachedService, Container, Processes
from rarms_iac.model.system import Component
from rarms_iac.texts.findings import Finding

RUN_AS_ROOT = Finding.warning("RARMS441", "Components run as root")


def components_as_root(components: Iterable[Component]) -> tuple[str, ...]:
    """Return the names of components that rarms starts as root here; of a container, its image says who runs it."""
    if sys.platform != "linux" or os.geteuid() != 0:
        return ()
    return tuple(component.name for component in components if _runs_as_root(component))


def _runs_as_root(component: Component) -> bool:
    if component.run is None:
        return False
    processes = component.run.each_process.values()
    return any(
        not process.user and not isinstance(process.start, AttachedContainer | AttachedService | Container | Processes)
        for process in processes
    )


def run_as_root(names: tuple[str, ...], places: Places) -> Diagnostic:
    """Make the warning that names all of these components.

    Args:
        names: at least one; the warning stands at the first.
    """
    return RUN_AS_ROOT.at(
        places.key("components", names[0], "run"),
        "{components:all} {_run} as root, with all rights on this machine.",
        "Use a user with only the necessary rights: `run: { user: robot, groups: [video] }`.",
        address=f"component/{names[0]}",
        components=names,
        _run="runs" if len(names) == 1 else "run",
    )
