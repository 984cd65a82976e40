"""Data logs, configuration logs and the tuning log, as JSON Lines (docs/data-logs.md).

Measured settings come in and are appended, a line each; a whole log goes out, or says why it cannot be read. Begin with
`files.read_log` and `log` (what a log holds). `identity` works out what can change the PI, and says what did.
`decisions` has the other two logs, and `merging` adds records from elsewhere.
"""
