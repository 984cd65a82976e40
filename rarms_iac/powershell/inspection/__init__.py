"""Checks a script before it is shown or run: only what is known to be harmless passes.

In: the bytes of a script and its kind. Out: diagnostics, none where it may be run. Begin at `inspect.inspect`;
`allowed` holds the lists, and `steps` compares the tree of a script with the tree of its template.
"""
