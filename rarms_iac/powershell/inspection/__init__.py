"""Checks a script before it is shown or run: only what has the form of rarms' own scripts passes.

In: the bytes of a script. Out: diagnostics, none where it may be run. Begin at `inspect.inspect`: `encoding` looks at
the bytes, `parts` holds what is fixed in a script, and `steps` compares the tree of the rest with the tree of its
template; `recorded` does both for a script out of a journal, which another version may have made.
"""
