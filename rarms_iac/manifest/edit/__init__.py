"""Texts of manifests written again: one value changed in place, or all of it in canonical form, with its comments.

A text comes in, a text goes out. `values` sets and removes; `formatting` gives the canonical form, whose order of keys
and lines are made by `write`. Begin with `values` or `formatting`.
"""
