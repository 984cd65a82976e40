"""The use cases: one module for each thing that a user wants done, as functions from values to values.

What comes in: a manifest that was read, a frozen request, and what the caller wants to be told meanwhile (a reporter,
a `should_stop`). What comes out: a frozen result with its findings; the caller decides how it is shown and which exit
code it means. Nothing here knows click, a terminal, or the words of a view.
"""
