"""Why there is no layout, and what would fit.

In comes a problem for which `packing.pack` found nothing; out come the partitions that cannot share their hosts, and
changes of the manifest with which everything fits. Begin with `explain.explain`. `conflict` finds who cannot share;
`relaxations` are what can be changed by more or by less; `edits` plans them: a way out is planned before it is offered.
"""
