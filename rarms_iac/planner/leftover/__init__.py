"""What is left over once all reservations are met: limits and weights, and in guests processors and priorities."""
