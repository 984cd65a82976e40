"""The fields of a manifest as pydantic reads them, each with its type, default and description.

Plain values come in (`manifest.ManifestDocument`), a document or findings go out (`messages`). `fields` and
`quantities` have what blocks share, also the keys that need or exclude each other; `schema` is the JSON Schema that is
made from all this. Begin with `manifest`.
"""
