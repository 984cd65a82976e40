"""The manifest: YAML text -> `System`, with the place of every value.

Files that a user names come in; `load.load_system` gives the `System` and ordered findings: begin there. On the way:
`text` (characters, YAML, positions), `overlays`, `document` (reads the values as the types of the model say, and has
their JSON Schema and messages), `checks` (what the manifest means) and `acceptance`. `edit` changes and formats a text
with its comments.
"""
