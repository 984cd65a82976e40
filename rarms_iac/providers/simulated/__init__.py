"""A host that needs nothing installed: one JSON file that refuses what Hyper-V refuses (docs/simulated-host.md).

The manifest's description of the machine comes in with every call; states, readings and journals go out. Begin with
`provider.SimulatedHostProvider`: it asks `refusals.py` whether an operation is refused, and `content.py` has the file
and what operations make of it. `measuring.py` runs what is on the host in the model of a hypervisor's scheduler
(`scheduling/`).
"""
