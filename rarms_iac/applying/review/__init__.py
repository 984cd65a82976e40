"""Findings that a reviewer of a plan should see before it is applied.

In: one host's part of a plan with the host as observed (`ReviewedPlan`). Out: diagnostics. Begin at `review_plan`;
`changes` looks at single changes and steps, `host_effects` at the host as a whole.
"""
