# SPDX-License-Identifier: Apache-2.0
"""A conversation without a policy: the robot says again what it hears, and lifts an arm for a moment."""

from dataclasses import dataclass, field

import torch
from lerobot.robots import Robot

from lerobot_owlxt5.conversation import Line
from lerobot_owlxt5.scene import Thing
from nico_tabletop.nico_sim import NicoSim

ELBOW = "r_elbow_y.pos"
STEPS = 5


@dataclass
class EchoConversation:
    """See `lerobot_owlxt5.conversation.Conversation`. "break" breaks it, "watch me" lets it watch."""

    robot: Robot
    lines: list[Line] = field(default_factory=list)
    left: int = 0
    watching: bool = False

    @property
    def busy(self) -> bool:
        return self.left > 0

    @property
    def things(self) -> list[Thing]:
        assert isinstance(self.robot, NicoSim)
        simulation = self.robot.simulation
        boxes = torch.from_numpy(simulation.object_boxes(4 / 3))
        return [Thing(name, box) for name, box in zip(simulation.arrangement, boxes, strict=True)]

    @property
    def looking_at(self) -> Thing | None:
        return self.things[0] if self.busy else None

    def hear(self, words: str) -> None:
        if words == "break":
            raise RuntimeError("a secret of /home/somebody")
        self.lines += [Line("person", words), Line("robot", f"I heard: {words}")]
        self.watching = words == "watch me"
        self.left = 0 if words in ("watch me", "done") else STEPS

    def point(self, x: float, y: float) -> None:
        self.lines.append(Line("robot", f"You point at {x:.2f} {y:.2f}"))

    def tick(self) -> None:
        if self.left:
            self.left -= 1
            observation = self.robot.get_observation()
            joints = {joint: observation[joint] for joint in self.robot.action_features}
            self.robot.send_action(joints | {ELBOW: joints[ELBOW] + 5})

    def stop(self) -> None:
        self.left = 0

    def home(self) -> None:
        self.left = STEPS
