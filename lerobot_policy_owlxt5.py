# SPDX-License-Identifier: Apache-2.0
"""LeRobot's door to this plugin: importing it registers the policies and the environments.

LeRobot imports the module that bears the distribution's name (`lerobot_policy_owlxt5`) in every command.
"""

import lerobot_owlxt5  # noqa: F401  registers the policies `owlxt5` and `crosst5`
import nico_tabletop.configuration  # noqa: F401  registers the environments `clant` and `claeo`
