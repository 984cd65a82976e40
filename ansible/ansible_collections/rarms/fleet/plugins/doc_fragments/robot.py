# Copyright: the rarms authors. Apache-2.0 (see LICENSE).
"""Options and remarks that all modules of the collection share."""

from __future__ import annotations


class ModuleDocFragment:
    """The robot, and how it is reached."""

    DOCUMENTATION = """
options:
  manifest:
    description:
      - The manifest, or the folder of a manifest, on the controller.
      - The inventory plugin P(rarms.fleet.manifests#inventory) sets it as C(rarms_manifest).
    type: path
  overlays:
    description: Overlays of this robot; the last one has priority. Default is C(rarms_overlays) of the inventory.
    type: list
    elements: path
  host:
    description: The host of the manifest for this robot. Default is C(rarms_host) of the inventory, or the only host.
    type: str
  unreachable:
    description:
      - The result for a robot that cannot be reached.
      - V(failed) counts for C(max_fail_percentage) and C(any_errors_fatal). In ansible-core, an unreachable host in a
        batch switches off both settings, see ansible/ansible#56265.
    type: str
    choices: [failed, unreachable]
    default: failed
requirements:
  - rarms-iac in the environment of ansible-core on the controller
  - the same version of rarms on each Linux robot
attributes:
  check_mode:
    support: none
    description: Can run in C(check_mode) and show the changes.
  diff_mode:
    support: none
    description: Returns the changes in diff mode, one entry for each address.
  action:
    support: full
    description: Runs on the controller, and uses Ansible's own connection to the robot.
"""
