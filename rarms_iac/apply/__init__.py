"""Making a plan for live hosts, walking it, resuming it, taking it back, and looking again."""
