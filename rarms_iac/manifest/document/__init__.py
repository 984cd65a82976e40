"""Plain values of a manifest -> the `System`, or findings about its structure.

The fields are those of the model that have a `Key` (`model/keys.py`). `reader` makes of their types what pydantic
reads, and `marks` has the meaning of their marks. `rules` has the keys that need or exclude each other, `schema` the
JSON Schema. Begin with `validate_document`; `messages` has the words for what is wrong.
"""
