"""Plan <-> versioned JSON, sealed: what was reviewed is what runs."""
