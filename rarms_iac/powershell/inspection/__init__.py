"""Looks at a script before it is shown or run: only what is known to be harmless passes (DESIGN section 6)."""
