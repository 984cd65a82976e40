"""Two states of a host to what has to change: partitions, task classes, SystemResponsiveness."""
