"""A discrete-event model of how a hypervisor shares processors (docs/scheduling-model.md): pure, seeded, no files.

A machine (`machine.py`) and a seed come in, jobs go out in the order in which they end. Begin with
`simulation.SchedulerSimulation`; programs are there, too. `hypervisor.py` places threads on virtual processors, and
these on logical ones.
"""
