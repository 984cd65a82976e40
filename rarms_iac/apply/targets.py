"""`--target`: only what stands at these addresses, and what lies below them."""

from collections.abc import Sequence

from rarms_iac.model.changes import Change
from rarms_iac.model.diagnostics import Diagnostic, Finding, Severity
from rarms_iac.model.wording import suggestion

NO_SUCH_TARGET = Finding(code="RARMS194", severity=Severity.ERROR, summary="Nothing changes at this target")


def is_below(address: str, targets: Sequence[str]) -> bool:
    """Whether the address is one of the targets, or lies below one; without targets everything is meant."""
    return not targets or any(address == target or address.startswith(f"{target}/") for target in targets)


def targeted(changes: Sequence[Change], targets: Sequence[str]) -> tuple[Change, ...]:
    """The changes that are meant."""
    return tuple(change for change in changes if is_below(str(change.address), targets))


def without_change(addresses: Sequence[str], targets: Sequence[str]) -> tuple[Diagnostic, ...]:
    """A finding for each target at which no host changes anything: most often a slip of the pen."""
    return tuple(
        NO_SUCH_TARGET.at(
            None,
            f"`--target {target}`: no change has this address or lies below it.{suggestion(target, addresses)}",
            "Give an address as `rarms plan` shows it, such as partition/vision, or leave the option out.",
            address=target,
        )
        for target in targets
        if not any(is_below(address, [target]) for address in addresses)
    )
