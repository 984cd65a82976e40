"""Text -> plain values and positions.

Bytes of a file come in (`reading.read_yaml`), plain values with everything that is wrong in the text go out.
`characters` and `events` see unchecked text and stop at the first excess. One pass in `events` gives the values and
where each stands; `tree` makes a tree of both, with comments, and finds the place of a path. Begin with `reading`.
"""
