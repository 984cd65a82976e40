"""What to do where none of the loads that a component is measured beside takes all that P2 reserves."""

from collections.abc import Sequence

from rarms_iac.model.commands import Prose, RecommendedCommand, prose
from rarms_iac.model.host import Host
from rarms_iac.model.loads import BUSY_LOOP, could_take_all
from rarms_iac.model.quantities import show_processors
from rarms_iac.model.system import System


def advice_on_weak_loads(
    system: System, host: Host, members: Sequence[str], loads: Sequence[str], measure: RecommendedCommand
) -> Prose:
    """Say what leads to an answer; a busy loop is no way out where it is weak itself.

    Args:
        members: names of components that run together, at least one.
        loads: beside which they are measured.
        measure: measures them beside a busy loop.
    """
    each = f"for each of the {show_processors(host.logical_processors)}"
    owner = f"components.{members[0]}" if system.components[members[0]].interference else "policy"
    if not could_take_all(system.interference[BUSY_LOOP], host.logical_processors):
        way = f"Let `interference.{BUSY_LOOP}` be a busy loop without `threads`, so that it has one {each}"
    elif BUSY_LOOP in loads:
        way = (
            f"`{BUSY_LOOP}` has a thread {each} and was kept from running on them: by other work on the machine, by a "
            "limit, or by processors that its partition may not use. Find out which"
        )
    elif BUSY_LOOP in system.loads_of(members):
        return prose(f"Measure beside `{BUSY_LOOP}` as well, as the manifest says: ", measure, ".")
    else:
        way = f"Name `{BUSY_LOOP}` in `{owner}.interference`, so that plans rest on it, too"
    return prose(f"{way}, and measure beside it: ", measure, ".")
