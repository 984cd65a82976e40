"""Changes to guarded steps, in an order in which the host never promises too much."""
