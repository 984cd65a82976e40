"""Why everything does not fit, and what would make it fit: each way out is planned before it is told."""
