"""One module a command; each is imported only when its command runs.

Options that click has read come in, an exit code goes out. In between a command makes one request, calls one use case
of `rarms_iac.app` and hands the result to a view. Begin with `validate_command`, and `plan_command` for one on hosts.
"""
