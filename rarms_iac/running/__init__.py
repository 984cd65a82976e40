"""Starting components and loads as real processes, and reading their samples (DESIGN section 1, `run`)."""
