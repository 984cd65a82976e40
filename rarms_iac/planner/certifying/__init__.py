"""What is claimed of a packing, and the checker of it, which imports nothing of what made it."""
