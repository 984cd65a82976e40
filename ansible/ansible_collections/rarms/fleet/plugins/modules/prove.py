# Copyright: the rarms authors. Apache-2.0 (see LICENSE).
"""The documentation of the action plugin of this name."""

from __future__ import annotations

DOCUMENTATION = """
module: prove
author: The rarms authors (@rarms)
short_description: Prove that all components of a robot meet their thresholds together
version_added: 0.1.0
description:
  - Runs all components in the applied layout, under the loads of the manifest's policy, and fails if a
    threshold is missed or inconclusive.
  - The proof uses all idle time of the robot.
  - A Linux robot proves itself. It needs C(rarms) of the controller's version, and the components' files in the folder
    that the manifest names, C(connect) with C(folder).
extends_documentation_fragment: rarms.fleet.robot
options:
  load_host:
    description: Set this to true, because the proof uses all idle time of the robot.
    type: bool
    default: false
"""

EXAMPLES = """
- name: Prove the first robot of a roll-out before the other robots
  rarms.fleet.prove:
    load_host: true
"""

RETURN = """
proof:
  description: The proof, as C(rarms prove --json) writes it.
  type: dict
  returned: always
"""
