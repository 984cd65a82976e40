"""System -> Layout: which component runs in which partition on which host, with which reservation.

In come the model's `System`, a source of reservations and what is known of the hosts; out comes a `Layout`, or
`Infeasible` with who cannot share what and which changes would fit. Begin with `layout.plan_layout`: `groups` says who
shares a partition, `sizes` what a partition gets on a host, `problem` what is to be placed, `packing` places it,
`infeasibility` explains why nothing fits. `combining` decides whom to combine, `prediction` what that would probably
need.
"""
