"""The Linux host: a partition that runs is a control group.

`groups` is the kernel's side, both of its versions; nothing there knows of partitions or plans.
"""
