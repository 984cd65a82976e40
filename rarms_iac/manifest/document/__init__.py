"""The manifest as pydantic reads it: one module a block, every field with its type, default and description."""
