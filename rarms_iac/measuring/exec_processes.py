"""Refuses to start a component that runs through `rarms run --exec` on this machine.

In: a manifest and names of components. Out: an error with a finding for each that runs. Begin at `refuse_running`.
"""

from collections.abc import Iterable

from rarms_iac.app.manifests import Manifest
from rarms_iac.app.use_case_errors import Outcome, UseCaseError
from rarms_iac.running.run_exec import find_exec_process
from rarms_iac.texts.findings import CANNOT_RUN


def refuse_running(manifest: Manifest, components: Iterable[str]) -> None:
    """Refuse components that run on this machine through `rarms run --exec`: a second process would disturb the first.

    Raises:
        UseCaseError: One of them runs (failed).
        UnreadableFile: A file of `/proc` is not as the kernel writes it.
    """
    running = {name: find_exec_process(exec_name(manifest, name)) for name in components}
    findings = [
        CANNOT_RUN.at(
            manifest.places.key("components", name, "run"),
            '"{component}" already runs: process {process} is from `rarms run --exec`.',
            "Stop the service of this process, then run the same command again. ROS 1 ends a node when a second node "
            "with its name starts.",
            address=f"component/{name}",
            component=name,
            process=process,
        )
        for name, process in running.items()
        if process is not None
    ]
    if findings:
        raise UseCaseError(Outcome.FAILED, findings, manifest.sources)


def exec_name(manifest: Manifest, component: str) -> str:
    """Return the name of a component as `ExecProcess.component` has it."""
    return f"{manifest.system.application.name}/{component}"
