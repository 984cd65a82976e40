"""Components and interfering loads as real processes on this machine (docs/running.md).

A component's `run` comes in, samples go out as they happen. Begin with `component.ComponentRun`: `start.py` resolves
what is to be started, `supervisor.py` drives the small process (`supervisor_process.py`, on Windows
`supervisor_process_windows.py`) that stands between rarms and the component and leaves nothing of it behind,
`reading.py` reads its lines, `samples.py` makes samples of them. `loads.py` runs interfering loads; `caller.py` and
`instances.py` are programs of their own, with the standard library only.
"""
