# SPDX-License-Identifier: Apache-2.0
"""LeRobot's robot type `nico_sim`: `lerobot-rollout --robot.type=nico_sim`.

LeRobot finds the robot itself by this module's name, in `nico_sim`.
"""

from dataclasses import dataclass

from lerobot.robots import RobotConfig

from .drawing import check_image_size
from .objects import read_objects
from .placement import find_placement


@RobotConfig.register_subclass("nico_sim")
@dataclass(kw_only=True)
class NicoSimConfig(RobotConfig):
    """What stands on the simulated NICO's table, and how it is seen.

    Attributes:
        objects: The name of a shipped set (`clant`, `claeo`, `household`) or the path of a YAML file
            (docs/objects.md).
        arrangement: The left, middle and right object, such as `red,green,blue`; drawn when unset.
        placement: `slots` (CLANT's three places), `free` (anywhere in reach, at any yaw) or `mixed`.
        seed: Of what is drawn: the same scenes as in the environments, one after another.
        height: Rows of the eyes' image.
        width: Columns of the eyes' image.
        reset_when_idle: Lay the table anew when LeRobot's reset phase only watches, as a person would.
        viewer: Open MuJoCo's viewer; needs a screen.
        expressive_head: Turn the head to things, nod and shake it where a conversation asks for that; it is
            drawn for bystanders alone.
    """

    objects: str = "clant"
    arrangement: str | None = None
    placement: str = "slots"
    seed: int = 0
    height: int = 240
    width: int = 320
    reset_when_idle: bool = False
    viewer: bool = False
    expressive_head: bool = True

    def __post_init__(self) -> None:
        """Check the options before a policy is loaded.

        Raises:
            ValueError: If an option cannot be used.
        """
        super().__post_init__()
        check_image_size(self.height, self.width)
        find_placement(self.placement)
        read_objects(self.objects)
        if self.seed < 0:
            raise ValueError(f"the seed must not be negative; got --robot.seed={self.seed}")
