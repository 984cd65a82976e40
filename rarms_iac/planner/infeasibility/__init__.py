"""Why there is no layout, and what would fit (DESIGN section 3).

In comes a problem for which `packing.pack` found nothing; out come the partitions that cannot share their hosts, the
findings that say so, and changes of the manifest with which everything fits. Begin with `explain.explained`.
`conflict` finds who cannot share; `edits` are changes of a manifest; `lowering` looks for lower APTs and reserves;
`ways_out` asks for a few of each kind. A way out is planned before it is told.
"""
