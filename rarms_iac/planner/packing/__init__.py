"""Partitions onto hosts: least reservation in all, then fewest moves, then names.

In come partitions with what each would claim on each host (`Item`) and hosts with what they can promise (`Bin`); out
comes a `Packing` with the bounds that no other is below, or `NoPacking`. Begin with `pack.pack`.

`first_fit` makes a start. Where that meets `bounds`, nothing more is asked. Otherwise `assignment` writes the choice of
hosts as a program in whole numbers, and `highs` lets HiGHS solve it. What HiGHS answers is checked in `pack`.
"""
