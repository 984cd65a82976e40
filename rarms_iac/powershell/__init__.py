"""Generated PowerShell.

In: a host's part of a plan. Out: scripts as bytes, ASCII with CRLF, and findings on scripts. Begin at
`render.render_scripts`: `calls` turns a step into guarded pieces of calls, `literals` is the one way for a value into a
script, `templates` holds what is fixed. `inspection` checks a script before it is shown or run, `outline` reads back
what a script does, and compares two of them.
"""
