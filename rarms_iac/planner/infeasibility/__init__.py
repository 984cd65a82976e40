"""Why there is no layout, and what would fit.

In comes a problem for which `packing.pack` found nothing; out come the partitions that cannot share their hosts, and
changes of the manifest with which everything fits. Begin with `causes.explain_infeasibility`. `conflict` finds who
cannot share; `relaxations` are what can be changed by more or by less, `edits` plans them, and `ways_out` offers those
that were planned with success.
"""
