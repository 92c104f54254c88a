# SPDX-License-Identifier: Apache-2.0
"""The tabletop world as a LeRobot robot: stock commands run on it as on a real NICO.

Time is counted in actions: each moves the world on by one control period, 0.1 s. Between actions it stands
still, so a slow computer changes nothing. At ten frames a second it runs in real time.
"""

import logging
from collections.abc import Sequence
from functools import cached_property
from typing import Any

import numpy as np
from lerobot.lerobot_types import RobotAction, RobotObservation
from lerobot.robots import Robot
from lerobot.utils.decorators import check_if_already_connected
from lerobot.utils.errors import DeviceNotConnectedError

from .config_nico_sim import NicoSimConfig
from .head import Head, pose_towards
from .objects import read_objects
from .placement import Pose, find_placement
from .robot import EYES, JOINT_NAMES, joint_limits_deg
from .scoring import describe_changes
from .simulation import TabletopSimulation
from .tasks import arrangements
from .viewer import Viewer

logger = logging.getLogger(__name__)

IDLE_OBSERVATIONS = 5
"""So many observations in a row, without an action between them, are no policy's: its strategy waits."""

_JOINTS = tuple(f"{name}.pos" for name in JOINT_NAMES)


class NicoSim(Robot):
    """NICO at a table with three objects, in MuJoCo.

    Observation:
        <joint>.pos: float, measured joint angle, degrees; the ten of `robot.JOINT_NAMES`, in their order.
        eyes: uint8 (height, width, 3), RGB, the image between NICO's eyes.

    Action: `<joint>.pos`, float, where each of the ten joints shall be after 0.1 s, degrees.

    What was done on the table is logged when the table is laid anew and on `disconnect`, as the world judges
    it (`scoring`): "push red: perfect". There is nothing to calibrate or to configure.
    """

    config_class = NicoSimConfig
    name = "nico_sim"

    def __init__(self, config: NicoSimConfig) -> None:
        super().__init__(config)
        self.config = config
        self._simulation: TabletopSimulation | None = None
        self._viewer: Viewer | None = None
        self._head = Head()

    @property
    def simulation(self) -> TabletopSimulation:
        """The running world: ground truth, for tests and measurements.

        Raises:
            DeviceNotConnectedError: Before `connect` and after `disconnect`.
        """
        if self._simulation is None:
            raise DeviceNotConnectedError("NicoSim is not connected; call connect() first")
        return self._simulation

    @cached_property
    def observation_features(self) -> dict[str, Any]:
        """Joints and camera, as LeRobot describes them."""
        return dict.fromkeys(_JOINTS, float) | {EYES: (self.config.height, self.config.width, 3)}

    @cached_property
    def action_features(self) -> dict[str, Any]:
        """The joints, as LeRobot describes them."""
        return dict.fromkeys(_JOINTS, float)

    @property
    def is_connected(self) -> bool:
        """Whether the world is running."""
        return self._simulation is not None

    @property
    def is_calibrated(self) -> bool:
        """True: a simulated joint knows its angle."""
        return True

    def calibrate(self) -> None:
        """Do nothing."""

    def configure(self) -> None:
        """Do nothing."""

    @check_if_already_connected
    def connect(self, calibrate: bool = True) -> None:
        """Make the world, lay the table and open the viewer, if it is asked for.

        Args:
            calibrate: LeRobot's; there is nothing to calibrate.

        Raises:
            ValueError: If the arrangement cannot be had.
            DrawingError: If there is no screen for the viewer.
        """
        simulation = TabletopSimulation(read_objects(self.config.objects))
        self._random = np.random.default_rng(self.config.seed)
        self._lay_table(simulation, self._arrangement, None)
        if self.config.viewer:
            self._viewer = Viewer(simulation)
        self._simulation = simulation

    @property
    def _arrangement(self) -> list[str] | None:
        named = self.config.arrangement
        return None if named is None else [name.strip() for name in named.split(",")]

    def reset(
        self, arrangement: Sequence[str] | None = None, poses: Sequence[Sequence[float]] | None = None
    ) -> None:
        """Say what was done, lay the table anew and put the arms into the initial pose.

        Args:
            arrangement: Names of the left, middle and right object; as configured when None.
            poses: Where they stand, (x, y, yaw) in metres and degrees, see `placement.Pose`; drawn from the
                configured placement when None.

        Raises:
            DeviceNotConnectedError: Before `connect` and after `disconnect`.
            ValueError: If there are not three different known names and three poses.
        """
        simulation = self.simulation
        self._log_changes()
        self._lay_table(simulation, arrangement or self._arrangement, poses)
        self._show()

    def _lay_table(
        self,
        simulation: TabletopSimulation,
        arrangement: Sequence[str] | None,
        poses: Sequence[Sequence[float]] | None,
    ) -> None:
        # In the order of `TabletopEnv.reset`: a seed shows the same scene here and there.
        if arrangement is None:
            choices = arrangements(tuple(simulation.objects))
            arrangement = choices[self._random.integers(len(choices))]
        if poses is None:
            poses = find_placement(self.config.placement)(self._random)
        simulation.reset(arrangement, [Pose(*pose) for pose in poses])
        self._start = simulation.object_positions()
        self._head = Head()
        self._acted = False
        self._idle = 0
        logger.info("On the table, from NICO's left to its right: %s", ", ".join(simulation.arrangement))

    def _log_changes(self) -> None:
        if self._acted:
            end = self.simulation.object_positions()
            logger.info("What was done: %s", describe_changes(self.simulation.arrangement, self._start, end))

    def _show(self) -> None:
        if self._viewer is not None:
            self._viewer.show()

    def get_observation(self) -> RobotObservation:
        """Joint angles and image of this moment; see the class. The world does not move on.

        With `reset_when_idle`, the fifth observation in a row shows a table laid anew.

        Raises:
            DeviceNotConnectedError: Before `connect` and after `disconnect`.
            DrawingError: If MuJoCo cannot draw on this machine.
        """
        simulation = self.simulation
        self._idle += 1
        if self.config.reset_when_idle and self._acted and self._idle >= IDLE_OBSERVATIONS:
            self.reset()
        angles = simulation.joint_positions_deg.tolist()
        image = simulation.render(EYES, self.config.height, self.config.width)
        return dict(zip(_JOINTS, angles, strict=True)) | {EYES: image}

    def send_action(self, action: RobotAction) -> RobotAction:
        """Move for one control period (0.1 s) towards joint targets; see the class.

        Returns:
            The targets, cut at the joints' limits.

        Raises:
            DeviceNotConnectedError: Before `connect` and after `disconnect`.
            ValueError: If joints are missing, or the robot has no such joints.
            JointTargetError: If a target is NaN or infinite.
        """
        simulation = self.simulation
        if problems := set(_JOINTS) ^ set(action):
            raise ValueError(
                f"an action has one target for each of {', '.join(_JOINTS)}; missing or unknown: "
                f"{', '.join(sorted(problems))}"
            )
        target = np.array([float(action[joint]) for joint in _JOINTS])
        simulation.step(target)
        self._acted = True
        self._idle = 0
        self._show()
        return dict(zip(_JOINTS, np.clip(target, *joint_limits_deg().T).tolist(), strict=True))

    def look_at(self, x: float, y: float) -> None:
        """Turn the head to a place in the eyes' image, within one second; the camera stays where it is.

        Args:
            x: From the image's left edge, as a share of its width.
            y: From its upper edge, as a share of its height; (0.5, 0.5) is where the camera looks.

        Raises:
            DeviceNotConnectedError: Before `connect` and after `disconnect`.
        """
        fovy = float(self.simulation.model.camera(EYES).fovy[0])
        self._head.turn_to(pose_towards(x, y, self.config.width / self.config.height, fovy))

    def nod(self) -> None:
        """Nod once, within one second."""
        self._head.nod()

    def shake(self) -> None:
        """Shake the head once, within one second."""
        self._head.shake()

    def express(self) -> None:
        """Go on with looking, nodding and shaking for one control period (0.1 s); the world does not move on.

        Raises:
            DeviceNotConnectedError: Before `connect` and after `disconnect`.
        """
        simulation = self.simulation
        if self.config.expressive_head:
            simulation.head_deg = self._head.next_pose()

    def disconnect(self) -> None:
        """Say what was done, and free the world and the viewer.

        Raises:
            DeviceNotConnectedError: Before `connect`, and the second time.
        """
        simulation = self.simulation
        self._log_changes()
        if self._viewer is not None:
            self._viewer.close()
        simulation.close()
        self._viewer = self._simulation = None
