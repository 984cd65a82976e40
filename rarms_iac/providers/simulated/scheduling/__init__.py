"""A discrete-event model of how a hypervisor shares processors (docs/scheduling-model.md): pure, seeded, no files.

A machine (`machine.py`) and a seed come in, jobs go out in the order in which they end. Begin with
`simulation.SchedulerSimulation`. `hypervisor.py` places virtual processors on logical ones (`processors.py`),
`guest.py` places threads on virtual processors, `programs.py` has what runs: components, busy loops, browsers
and interrupts.
"""
