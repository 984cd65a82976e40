# Copyright: the rarms authors. Apache-2.0 (see LICENSE).
"""Options and remarks that all modules of the collection share."""

from __future__ import annotations


class ModuleDocFragment:
    """The robot, and how it is reached."""

    DOCUMENTATION = """
options:
  manifest:
    description:
      - The manifest, or the folder of one, on the controller.
      - The inventory plugin P(rarms.fleet.manifests#inventory) sets it as C(rarms_manifest).
    type: path
  overlays:
    description: Overlays of this robot, the last one wins; C(rarms_overlays) of the inventory otherwise.
    type: list
    elements: path
  host:
    description: Which host of the manifest this robot is; C(rarms_host) of the inventory, or the only one, otherwise.
    type: str
  unreachable:
    description:
      - What a robot is that cannot be reached.
      - V(failed) counts for C(max_fail_percentage) and C(any_errors_fatal). In ansible-core an unreachable host in a
        batch switches both off (ansible/ansible#56265).
    type: str
    choices: [failed, unreachable]
    default: failed
requirements:
  - rarms-iac in the environment of ansible-core on the controller
  - the same version of rarms on each Linux robot
attributes:
  check_mode:
    support: none
    description: Can run in C(check_mode) and say what would change.
  diff_mode:
    support: none
    description: Returns what changes, an entry for each address, in diff mode.
  action:
    support: full
    description: Runs on the controller, and reaches the robot by Ansible's own connection.
"""
