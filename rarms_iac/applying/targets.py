"""What `--target` chooses of the changes of a plan, and the targets that there are not."""

from collections.abc import Sequence

from rarms_iac.model.changes import Change
from rarms_iac.model.commands import command, prose
from rarms_iac.model.diagnostics import Diagnostic
from rarms_iac.model.shared_findings import NO_TARGET
from rarms_iac.model.wording import suggestion


def is_below(address: str, targets: Sequence[str]) -> bool:
    """Whether the address is one of the targets or lies below one; True without targets."""
    return not targets or any(address == target or address.startswith(f"{target}/") for target in targets)


def targeted(changes: Sequence[Change], targets: Sequence[str]) -> tuple[Change, ...]:
    """Return the changes at and below the targets; all of them without targets."""
    return tuple(change for change in changes if is_below(str(change.address), targets))


def unknown_targets(addresses: Sequence[str], targets: Sequence[str]) -> tuple[Diagnostic, ...]:
    """Return a finding for each target at and below which there is none of the addresses: a slip of the pen."""
    return tuple(
        NO_TARGET.at(
            None,
            "`--target {target}`: nothing has this address or lies below it.{_suggestion}",
            prose(
                "Give an address such as partition/vision (",
                command("plan", verbose=True),
                " lists those that change), or leave the option out.",
            ),
            address=target,
            target=target,
            _suggestion=_suggestion(target, addresses),
        )
        for target in targets
        if not any(is_below(address, [target]) for address in addresses)
    )


def _suggestion(target: str, addresses: Sequence[str]) -> str:
    """Suggest a similar address; a name alone is looked for among partitions and task classes, too."""
    words = [target, f"partition/{target}", f"task/{target}"]
    for word in words:
        if word in addresses:
            return f' Did you mean "{word}"?'
    return next((message for word in words if (message := suggestion(word, addresses))), "")
