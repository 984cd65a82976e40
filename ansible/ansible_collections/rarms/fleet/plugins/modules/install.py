# Copyright: the rarms authors. Apache-2.0 (see LICENSE).
"""The documentation of the action plugin of this name."""

from __future__ import annotations

DOCUMENTATION = """
module: install
author: The rarms authors (@rarms)
short_description: Install the controller's version of rarms on a Linux robot, or remove it
version_added: 0.1.0
description:
  - Sends the wheels for the robot's own Python and processor over Ansible's connection. The robot needs Python 3.11 or
    newer, root by C(become) or by the connection, and no internet.
  - If another version left a run unfinished, that version finishes the run first.
  - Skips a robot that is not a Linux host.
extends_documentation_fragment: rarms.fleet.robot
options:
  state:
    description:
      - V(present) installs the version of the controller, and keeps the previous version.
      - V(absent) removes all versions. It fails if the robot still has partitions of rarms.
    type: str
    choices: [present, absent]
    default: present
  wheels:
    description:
      - A folder of wheels on the controller. Pip downloads missing wheels into this folder.
      - Without this folder, pip downloads all wheels for each robot.
    type: path
attributes:
  check_mode:
    support: full
"""

EXAMPLES = """
- name: Install rarms on the robot
  rarms.fleet.install:
    wheels: wheels
  become: true

- name: Remove rarms from the robot
  rarms.fleet.install:
    state: absent
  become: true
"""

RETURN = """
installed:
  description: The versions before and now, and the finished runs, as C(rarms install --json) writes them.
  type: dict
  returned: success, except in check mode
findings:
  description: Unfinished runs that stay on the robot; on failure the reason.
  type: list
  elements: dict
  returned: when something was done
robot:
  description: The robot's name in the inventory.
  type: str
  returned: always
"""
