"""Which components share a partition, so that their reservations fit (docs/combining.md).

CoIs that were measured alone come in, and answers to questions: does this compound meet its APTs at this reservation?
The next question goes out, or the best layout with whether that is proved. Begin with `questions.search` (a question
depends only on the answers so far); `candidates` is the graph of compounds, `layouts` finds the best layout of them.
`paper` is the paper's procedure; `oracle` is what a caller provides.
"""
