"""What measured samples say, and how surely: steady state, estimates, verdicts and the curve (docs/measuring.md)."""
