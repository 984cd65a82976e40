"""Generated PowerShell.

In: the steps of a run on a host. Out: scripts as bytes, ASCII with CRLF. Begin at `render.render_scripts`: `pieces`
turns a step into guarded pieces, `literals` is the one way for a value into a script and checks that PowerShell can
read it, `templates` has what is fixed, and `comparison` describes how the steps of two plans differ.
"""
