"""Texts of manifests written anew: one value changed in place, or all of it in canonical form, with its comments.

A text comes in, a text goes out. `values` sets and removes; `splice` finds where that is in the text;
`formatting` gives the canonical form, whose order of keys is in `order` and whose lines are made by `write`. Begin
with `values` or `formatting`.
"""
