"""A discrete-event model of how a hypervisor shares processors (docs/scheduling-model.md): pure, seeded, no files."""
