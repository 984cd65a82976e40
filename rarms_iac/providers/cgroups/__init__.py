"""The Linux host: a partition that runs is a control group.

In: operations of a plan. Out: the observed state, and samples of components. Begin at `run.py`, the provider;
`measuring.py` adds running components and loads. `content.py` (definitions and settings) is pure. `kernel.py`,
`groups.py` and `versions.py` are the kernel's side; nothing in these three knows of partitions or plans.
"""
