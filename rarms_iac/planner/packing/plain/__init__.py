"""Plain sizes, or vectors, into equal bins: many items, and published instances."""
