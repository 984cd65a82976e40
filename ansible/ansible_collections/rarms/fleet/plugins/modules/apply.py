# Copyright: the rarms authors. Apache-2.0 (see LICENSE).
"""The documentation of the action plugin of this name."""

from __future__ import annotations

DOCUMENTATION = """
module: apply
author: The rarms authors (@rarms)
short_description: Plan a robot, apply the plan, or remove everything that rarms created there
version_added: 0.1.0
description:
  - Creates and changes the robot's partitions and CPU reservations as its rarms manifest requires. The reservations fit
    the robot after each step.
  - A Linux robot needs the controller's version of C(rarms), which the role P(rarms.fleet.install#role) installs, and
    root, by C(become) or by the connection.
extends_documentation_fragment: rarms.fleet.robot
options:
  state:
    description:
      - V(planned) writes the changes to O(plan). C(--check --diff) with V(applied) shows the changes.
      - V(applied) applies the manifest, or exactly the plan in O(plan).
      - V(absent) removes everything with the application's mark, and keeps the disks of Hyper-V machines.
    type: str
    choices: [planned, applied, absent]
    default: applied
  plan:
    description:
      - A plan file on the controller. Each robot needs its own, so include C(inventory_hostname) in its name.
      - V(planned) writes the file and creates its folder. If no plan is possible, an earlier file is removed.
      - V(applied) applies the plan, unless it was edited or used, or the robot has changed since.
    type: path
  max_disruption:
    description: Hold back changes that disrupt more than this. Default is the manifest's policy.
    type: str
    choices: [live, partition_stop, host_restart, removal]
  unfinished:
    description: The action for an earlier, unfinished run on the robot.
    type: str
    choices: [finish, undo, abandon, fail]
    default: finish
  lock_timeout:
    description: The longest wait for a robot that another run has locked, such as V(60s).
    type: str
    default: 0s
attributes:
  check_mode:
    support: full
  diff_mode:
    support: full
"""

EXAMPLES = """
- name: Write plans for a review
  rarms.fleet.apply:
    state: planned
    plan: "plans/{{ inventory_hostname }}.json"

- name: Apply the reviewed plans
  rarms.fleet.apply:
    plan: "plans/{{ inventory_hostname }}.json"

- name: Apply the manifest without restarting a partition
  rarms.fleet.apply:
    max_disruption: live
"""

RETURN = """
has_changes:
  description: Whether the plan has changes, including held-back changes.
  type: bool
  returned: when a plan was made or read
plan:
  description: The plan, as C(rarms plan --json) writes it.
  type: dict
  returned: when a plan was made or read
run:
  description: The result of the run, as C(rarms apply --json) writes it.
  type: dict
  returned: when something was applied
robot:
  description: The robot's name in the inventory.
  type: str
  returned: always
findings:
  description: The reasons of the failure, as findings of rarms.
  type: list
  elements: dict
  returned: on failure
rarms_unreachable:
  description: Whether the robot could not be reached.
  type: bool
  returned: on failure
"""
