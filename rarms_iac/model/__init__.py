"""The terms of the problem: frozen values without sentences, standard library only.

Nothing comes in and nothing is done here: every other room takes these values and returns them. Begin with `system`
(what a manifest says; `host` and `run` are its parts), then follow the route: `layout` (where each component runs),
`state` (a host, desired or observed), `changes` and `operations` (what differs, and what one step does), `plan`, and
`journal` (what a host remembers). `setting`, `experiment`, `indexes` and `outcomes` are the words of measuring;
`facets` has the table of a partition's settings, `seen_host` a host as it was seen, `diagnostics` findings. Text of
these values is in `texts/`; the description of a manifest's key stays with its field, and is copied into the schema.
"""
