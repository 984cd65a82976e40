"""Generated PowerShell.

In: a host's part of a plan. Out: scripts as bytes, ASCII with CRLF, and findings on scripts. Begin at
`render.render_scripts`: `pieces` turns a step into guarded pieces, `literals` is the one way for a value into a
script, `templates` what is fixed. `statements` reads calls and tables out of a script's tree: with it `inspection`
holds a script to its template before it is shown or run, and `outline` tells what a script does, and compares two.
"""
