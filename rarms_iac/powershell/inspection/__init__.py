"""Checks a script before it is shown or run: only what has the form of rarms' own scripts passes.

In: the bytes of a script. Out: diagnostics, none where it may be run. Begin at `inspect.inspect`; `layout` holds what
is fixed to the byte, and `steps` compares the tree of the rest with the tree of its template.
"""
