"""The one machine-readable form of what rarms says: `schemas/output.json` is made from these types.

Within `rarms-output/2` fields and kinds may be added; none changes its meaning or goes. Amounts are plain numbers:
memory in bytes, reserve and limit in whole per cent of each virtual processor.
"""
