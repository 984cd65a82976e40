"""The manifest: YAML text -> checked document -> `System`, with the place of every value.

Files that a user names come in; `load.load_system` gives the `System` and ordered findings: begin there. On the way:
`text` (characters, YAML, positions), `overlays`, `document` (the fields as pydantic reads them, their JSON Schema, and
messages), `to_system`, `checks` (what the manifest means) and `acceptance`. `edit` changes and formats a text with its
comments.
"""
