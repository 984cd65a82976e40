"""Generated PowerShell: literals, templates, and the inspection that every script passes (DESIGN section 6)."""
