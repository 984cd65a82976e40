"""Files: the one reader, the two writers, and the formats of plans, snapshots and data logs.

Paths and frozen values come in, bytes on a disk go out, and the reverse. Begin with `reading.read_file` for what is
read (a regular file, up to a limit), and `writing` for the two writers and the lock. `codec` turns frozen values into
JSON and back, `json_text` gives the same value the same bytes and digest everywhere. `records`, `plan_file`,
`snapshot_file` and `datalog` are formats; `shipped` finds what is installed next to the code.
"""
