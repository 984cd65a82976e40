# Copyright: the rarms authors. Apache-2.0 (see LICENSE).
"""The documentation of the action plugin of this name."""

from __future__ import annotations

DOCUMENTATION = """
module: facts
author: The rarms authors (@rarms)
short_description: Read the partitions and proofs of a robot
version_added: 0.1.0
description:
  - Returns the status of the application on the robot, and a snapshot that C(rarms plan --snapshot) reads.
  - Changes nothing.
extends_documentation_fragment: rarms.fleet.robot
attributes:
  check_mode:
    support: full
"""

EXAMPLES = """
- name: Read the robot
  rarms.fleet.facts:

- name: Save a snapshot for plans of pull requests
  ansible.builtin.copy:
    content: "{{ ansible_facts.rarms.snapshot }}"
    dest: "snapshots/{{ inventory_hostname }}.json"
    mode: "0644"
  delegate_to: localhost
"""

RETURN = """
ansible_facts:
  description: Facts of the robot.
  type: dict
  returned: success
  contains:
    rarms:
      description: The status as C(rarms status --json) writes it, and the text of a snapshot.
      type: dict
      returned: success
"""
