"""Plain values of a manifest -> the `System`, or findings about its structure.

The fields are those of the model that have a `Key` (`model/keys.py`). `reader` makes of their types what pydantic's
core reads and what the JSON Schema says; `marks` has the meaning of the marks, `rules` the keys that need or exclude
each other. Begin with `validate_document`; `messages` has the words for what is wrong.
"""
