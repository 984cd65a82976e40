"""Text -> plain values and positions.

Bytes of a file come in (`reading.read_yaml`), plain values with everything that is wrong in the text go out.
`characters` and `events` see unchecked text and stop at the first excess, and `syntax` says why a text is no YAML;
`tree` builds the one tree with positions, and with comments where a text will be written again. `positions` finds the
place of a path in that tree. Begin with `reading`.
"""
