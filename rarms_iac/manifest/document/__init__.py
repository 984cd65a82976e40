"""The fields of a manifest as pydantic reads them, each with its type, default and description.

Plain values come in (`validate_document`), a document or findings go out (`messages`). `fields`, `text_forms` and
`quantities` have what blocks share, `rules` the keys that need or exclude each other; `schema` is the JSON Schema that
is made from all this. Begin with `manifest`.
"""
