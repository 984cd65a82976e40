"""The commands, those of a topic in a module, which is imported only when one of them runs.

Options that click has read come in, an exit code goes out. In between a command makes one request, calls one use case
of `rarms_iac.app` and hands the result to a view. `cli.group` says which is where; begin with `manifest_commands`, and
with `plan_command` for one on hosts.
"""
