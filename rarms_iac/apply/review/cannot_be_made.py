"""What Hyper-V would refuse in the middle of making a machine is refused before anything is done."""

from collections.abc import Iterator

from rarms_iac.apply.review.reviewed import Reviewed
from rarms_iac.model.diagnostics import Diagnostic, Finding, Severity
from rarms_iac.model.operations import CreatePartition
from rarms_iac.model.plan import Step
from rarms_iac.model.wording import suggestion

VHD = Finding(code="RARMS257", severity=Severity.ERROR, summary="A machine of generation 2 takes no .vhd disk")
SWITCH = Finding(code="RARMS258", severity=Severity.ERROR, summary="The host has no virtual switch of this name")


def review(part: Reviewed) -> Iterator[Diagnostic]:
    """Tells of machines that are to be made from what does not fit them or is not there."""
    for step in part.plan.steps:
        if isinstance(step.operation, CreatePartition):
            yield from _image(step, step.operation)
            yield from _switch(part, step, step.operation)


def _image(step: Step, making: CreatePartition) -> Iterator[Diagnostic]:
    if making.generation == 2 and making.image.lower().endswith(".vhd"):
        yield VHD.at(
            step.place,
            f'"{making.partition}" is to be of generation 2, and its disk would grow out of {making.image}: a child '
            "has its parent's format, and generation 2 takes .vhdx only.",
            "Convert the image (`Convert-VHD`) and name the .vhdx, or say `generation: 1` for this partition.",
            address=str(step.address),
        )


def _switch(part: Reviewed, step: Step, making: CreatePartition) -> Iterator[Diagnostic]:
    there = part.observed.switches
    if not making.switch or there is None or making.switch.lower() in {one.lower() for one in there}:
        return
    known = f"It has {', '.join(sorted(there))}." if there else "It has none."
    yield SWITCH.at(
        step.place,
        f'"{making.partition}" is to be connected to the virtual switch {making.switch!r}, which '
        f"{part.plan.host.name} does not have.{suggestion(making.switch, there)} {known}",
        "Name a switch that is there (`hyperv.switch`), or make it on the host first (`New-VMSwitch`).",
        address=str(step.address),
    )
