"""The Linux host: a partition that runs is a control group.

In: operations of a plan. Out: the observed state, and samples of components. Begin at `provider.py`; `measuring.py`
adds running components and loads. `definitions.py` has what a partition is to be, what its group's values show and
what is refused. `groups.py` and `trees.py` know what a setting is in the kernel, and `effects.py` how it is read and
written; nothing in these knows of partitions or plans. A Linux host behind a channel is `providers/robot.py`: its own
rarms does this there.
"""
