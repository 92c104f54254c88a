# SPDX-License-Identifier: Apache-2.0
"""LeRobot's door to this plugin: importing it registers policies, environments and the robot.

LeRobot imports the module that bears the distribution's name (`lerobot_policy_owlxt5`) in every command.
"""

import lerobot_owlxt5  # noqa: F401  registers the policies `owlxt5` and `crosst5`
import nico_tabletop.config_nico_sim  # noqa: F401  registers the robot `nico_sim`
import nico_tabletop.configuration  # noqa: F401  registers the environments `clant` and `claeo`
from lerobot_owlxt5.commands.parser import name_problem
from nico_tabletop.objects import NAME_CHECKS

# The world does not know how policies read commands: a file's objects must have names that they understand.
NAME_CHECKS.append(name_problem)
