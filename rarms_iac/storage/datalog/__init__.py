"""Measured settings <-> JSON Lines: data logs, what makes them stale, and configuration logs (DESIGN section 2)."""
