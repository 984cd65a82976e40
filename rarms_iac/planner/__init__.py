"""System -> Layout: which component runs in which partition on which host, with which reservation."""

from rarms_iac.planner.packing.equal import PackedSizes, pack_sizes

__all__ = ["PackedSizes", "pack_sizes"]
