# Copyright: the rarms authors. Apache-2.0 (see LICENSE).
"""The documentation of the action plugin of this name."""

from __future__ import annotations

DOCUMENTATION = """
module: measure
author: The rarms authors (@rarms)
short_description: Measure on one robot the CPU reservations that components need
version_added: 0.1.0
description:
  - Finds the least reservation with which each component meets its thresholds, for all robots of one platform.
  - Run it on one idle robot of each platform, as the role P(rarms.fleet.measure#role) does.
  - A simulated robot is measured on the controller. A Linux robot measures itself. It needs C(rarms) of the
    controller's version, and the components' files in the folder that the manifest names, C(connect) with C(folder).
  - The data logs are next to the manifest on the controller, for git. They grow with each measured setting.
extends_documentation_fragment: rarms.fleet.robot
options:
  components:
    description: The components to measure; empty means all that have a threshold.
    type: list
    elements: str
    default: []
  stop_partitions:
    description:
      - Stop the partitions that run on the robot while it measures; they start again afterwards.
      - Without it, a robot on which partitions run is not measured.
    type: bool
    default: false
"""

EXAMPLES = """
- name: Measure a camera's component on one robot of the platform
  rarms.fleet.measure:
    components: [face-detection]
"""

RETURN = """
measured:
  description: The result, as C(rarms measure --json) writes it.
  type: dict
  returned: always
logs:
  description: The data logs that the result uses.
  type: list
  elements: str
  returned: always
new_settings:
  description: The number of new settings. Recorded settings are not measured again.
  type: int
  returned: always
"""
