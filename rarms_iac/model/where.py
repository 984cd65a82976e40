"""Which line of the manifest asks for a thing that the manifest need not spell out."""

from rarms_iac.model.diagnostics import Place, Places
from rarms_iac.model.system import System


def partition_place(system: System, places: Places, name: str) -> Place:
    """Where the manifest asks for a partition: its own entry, or that of the component it is called after."""
    return places.key("partitions" if name in system.partitions else "components", name)
