"""The fields of a manifest as pydantic reads them, each with its type, default and description.

Plain values come in (`manifest.ManifestDocument`), a document or findings go out (`messages`). `fields` and
`quantities` have the types that blocks share, `rules` the keys that need or exclude each other, `schema` the JSON
Schema that is made from all this. Begin with `manifest`.
"""
