"""From a System and observed hosts to a plan, and from a plan to changed hosts.

In: a `PlanRequest` with the States of its hosts, or a `Plan` with live hosts. Out: a `Plan`, or a `RunReport`
with diagnostics. Begin at `make_plan` for planning (`desired_hosts` says what each host is to look like) and at
`execute.apply_plan` for applying: `run_steps` walks a plan on a host that is changed step by step, `run_script` has a
Hyper-V host run its own script. `undo` reverses the last run, `doctor` and `review` find what is wrong before.
"""
