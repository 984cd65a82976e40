"""A host that needs nothing installed and forgets nothing: one JSON file that refuses what Hyper-V refuses."""
