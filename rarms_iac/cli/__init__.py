"""The command line: options in, one call, one view, an exit code (DESIGN section 9)."""
