"""Hyper-V hosts, local, or over ssh or WinRM.

In: a host of the manifest. Out: its State, its condition, and events of the scripts that it runs. Begin at
`provider.open_hyperv`: `observation` holds what `observe.ps1` printed, `parse` makes a State of it, `condition` what
only the doctor asks for; `transport` runs scripts and talks with them, here or through a channel with the fixed
bootstrap.
"""
