"""Hosts: what every one of them must offer, and one folder for each kind.

Begin at `interface`: a `StepwiseHost` is changed one operation at a time, a `ScriptedHost` runs whole scripts.
`machines` reads and writes the mark, the line in a machine's notes that makes it a managed partition. `measuring` adds
what a host must offer to be measured on.
"""
