"""Combining CoIs so that their reservations fit: the paper's procedure, and the search of the candidate graph."""
