"""System -> Layout: which component runs in which partition on which host, with which reservation."""

from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from rarms_iac.planner.packing.plain.equal import PackedSizes, pack_sizes

__all__ = ["PackedSizes", "pack_sizes"]


def __getattr__(name: str) -> object:
    """The packing is imported when it is asked for: most commands never do, and starting up would wait for it."""
    if name not in __all__:
        raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
    from rarms_iac.planner.packing.plain import equal

    return getattr(equal, name)
