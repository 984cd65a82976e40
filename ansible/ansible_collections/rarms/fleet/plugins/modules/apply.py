# Copyright: the rarms authors. Apache-2.0 (see LICENSE).
"""The documentation of the action plugin of this name."""

from __future__ import annotations

DOCUMENTATION = """
module: apply
author: The rarms authors (@rarms)
short_description: Plan a robot, apply the plan, or remove what rarms made there
version_added: 0.1.0
description:
  - Makes the robot's partitions and CPU reservations as its rarms manifest wants them, in an order in which the robot
    never promises more than it has.
  - A Linux robot needs the controller's version of C(rarms), which the role P(rarms.fleet.install#role) puts there, and
    root, by C(become) or by the connection.
extends_documentation_fragment: rarms.fleet.robot
options:
  state:
    description:
      - V(planned) writes what would change to O(plan); C(--check --diff) with V(applied) shows it.
      - V(applied) does what the manifest asks for, or exactly what O(plan) says.
      - V(absent) removes everything that carries the application's mark; disks of Hyper-V machines are kept.
    type: str
    choices: [planned, applied, absent]
    default: applied
  plan:
    description:
      - A plan file on the controller; one for each robot, so its name should hold C(inventory_hostname).
      - V(planned) writes it, making its folder, and removes an earlier one where no plan can be made.
      - V(applied) does what it says, and refuses where it was edited or used, or where the robot changed since.
    type: path
  max_disruption:
    description: Hold back what disturbs more; as the manifest's policy says otherwise.
    type: str
    choices: [live, partition_stop, host_restart, removal]
  unfinished:
    description: What becomes of a run that was begun on the robot earlier and did not end.
    type: str
    choices: [finish, undo, abandon, fail]
    default: finish
  lock_timeout:
    description: How long to wait for a robot that another run holds, as V(60s).
    type: str
    default: 0s
attributes:
  check_mode:
    support: full
  diff_mode:
    support: full
"""

EXAMPLES = """
- name: What would change, as files for a review
  rarms.fleet.apply:
    state: planned
    plan: "plans/{{ inventory_hostname }}.json"

- name: Do exactly what was reviewed
  rarms.fleet.apply:
    plan: "plans/{{ inventory_hostname }}.json"

- name: Do what the manifest asks for, without a restart of any partition
  rarms.fleet.apply:
    max_disruption: live
"""

RETURN = """
has_changes:
  description: Whether the plan has changes, held-back ones too.
  type: bool
  returned: when a plan was made or read
plan:
  description: The plan, as C(rarms plan --json) writes it.
  type: dict
  returned: when a plan was made or read
run:
  description: How the run ended, as C(rarms apply --json) writes it.
  type: dict
  returned: when something was applied
robot:
  description: The robot's name in the inventory.
  type: str
  returned: always
findings:
  description: Why it failed, as findings of rarms.
  type: list
  elements: dict
  returned: on failure
rarms_unreachable:
  description: Whether the robot could not be reached.
  type: bool
  returned: on failure
"""
