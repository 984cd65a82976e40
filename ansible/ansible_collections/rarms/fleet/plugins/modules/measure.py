# Copyright: the rarms authors. Apache-2.0 (see LICENSE).
"""The documentation of the action plugin of this name."""

from __future__ import annotations

DOCUMENTATION = """
module: measure
author: The rarms authors (@rarms)
short_description: Measure the CPU reservations of components on one robot
version_added: 0.1.0
description:
  - Finds the smallest reservation at which each component meets its thresholds, for all robots of one platform.
  - Run this module on one idle robot of each platform, as the role P(rarms.fleet.measure#role) does.
  - A simulated robot is measured on the controller. A Linux robot measures itself. It needs C(rarms) of the
    controller's version, and the components' files in the folder that the manifest names, C(connect) with C(folder).
  - The data logs are next to the manifest on the controller, for git. They grow with each measured setting.
extends_documentation_fragment: rarms.fleet.robot
options:
  components:
    description: The components to measure. An empty list means all components with a threshold.
    type: list
    elements: str
    default: []
  stop_partitions:
    description:
      - Stop the running partitions of the robot for the measurement, then start them again.
      - Without this option, rarms does not measure on a robot with running partitions.
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
