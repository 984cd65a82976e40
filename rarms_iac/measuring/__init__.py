"""Sweeps, interfering loads, measurements: what CMCPUR does on a host, and what its end is proven by."""
