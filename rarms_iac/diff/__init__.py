"""The difference between a desired and an observed host, as ordered steps.

In: two `State`s of one host, `ManifestRules` and the `StepContext`. Out: `Change`s by address (`compare.compare`), each
with its steps (`steps.steps_for`), without those that disturb too much (`disruption.hold_back`), in an order in which
the host never promises more than it has (`order.order`). `drift` says who changed what since the last apply,
and whether a host changed since a plan was made, `readings` what a step's guard compares. Everything here is pure.
"""
