# SPDX-License-Identifier: Apache-2.0
"""The policy motion_library, a rival of OWLxT5: what it sees it moves with motions that nobody learnt.

After ELMiRA (docs/rivals.md): an open-vocabulary detector, calibrated camera geometry, inverse kinematics.
"""

from collections.abc import Sequence
from dataclasses import replace
from typing import TYPE_CHECKING, Any, NoReturn

import torch
from torch import Tensor

from .backbones.detections import Detections
from .backbones.pretrained import check_backbones
from .commands.answer import Target
from .commands.instruction import Instruction
from .commands.parser import object_name
from .commands.replies import ABILITIES
from .configuration_motion_library import MotionLibraryConfig
from .data.start_pose import start_tolerance
from .executing_policy import ExecutingPolicy
from .motion_library import MotionLibrary
from .object_point import ObjectPoint
from .scene import Moved, Search
from .sighting import Sighting

if TYPE_CHECKING:
    from lerobot.datasets import LeRobotDatasetMetadata

NO_SUCH_MOTION = f"I hold still, because I know no motion for that. {ABILITIES}"
NOTHING_TO_LEARN = (
    "The policy motion_library has nothing to learn: evaluate it with lerobot-eval "
    "--policy.type=motion_library, and train owlxt5."
)


class TablePlace(ObjectPoint):
    """Sees where on the table the named object stands.

    Its features are places, (batch, 1, 2), x forward and y to the robot's left, metres.
    """

    def __init__(self, config: MotionLibraryConfig) -> None:
        """Load the detector that the configuration names."""
        super().__init__(config)
        self._view, self._depth = config.table_view, config.object_depth

    def _points(self, detections: Detections) -> Tensor:
        """Places on the table, (samples, names, 2)."""
        return self._view.table_places(super()._points(detections), self._depth)


def out_of_reach(name: str) -> str:
    """Say that no arm reaches the thing of this name."""
    return f"I cannot reach the {object_name(name)}: put it in front of me."


class MotionLibraryPolicy(ExecutingPolicy):
    """Understands, searches and refuses as OWLxT5 does, and takes its movements from a `MotionLibrary`.

    It knows the place of the named object alone: its hand may touch what stands beside it.
    """

    config_class = MotionLibraryConfig
    name = "motion_library"
    config: MotionLibraryConfig
    model: MotionLibrary  # type: ignore[assignment]  # of a CrossmodalModel only `plan` is asked for
    visual: TablePlace  # type: ignore[assignment]  # nobody encodes episodes for training

    def __init__(
        self,
        config: MotionLibraryConfig,
        dataset_meta: "LeRobotDatasetMetadata | None" = None,
        **kwargs: Any,
    ) -> None:
        """Make the policy.

        Args:
            config: The configuration; its features are checked here.
            dataset_meta: Not used.
            **kwargs: What LeRobot passes to all policies and this one has no use for.

        Raises:
            ValueError: If the robot has other joints than NICO.
        """
        super().__init__(config)
        config.validate_features()
        check_backbones(config.backbones)
        self.model = MotionLibrary()
        n_joints = len(self.model.rest)
        if config.action_feature.shape != (n_joints,):
            raise ValueError(
                f"motion_library moves the {n_joints} joints of NICO's arms, and this robot's action has the "
                f"shape {config.action_feature.shape}: use it with --env.type=clant or claeo."
            )
        self.register_rest_pose(n_joints)
        span = self.model.high - self.model.low
        self.rest_pose = 2 * (self.model.rest - self.model.low) / span - 1
        self.rest_tolerance = torch.from_numpy(start_tolerance(self.rest_pose[None].numpy(), span.numpy()))
        self.visual = TablePlace(config)
        self.reset()

    def _instruct(self, task: str, before: Target | None) -> Instruction:
        """As all do; but without a verb there is no motion."""
        instruction = super()._instruct(task, before)
        if instruction.verb or instruction.reply or instruction.wants_report:
            return instruction
        return replace(instruction, reply=NO_SUCH_MOTION)

    def _look(
        self, batch: dict[str, Any], searches: Sequence[Search], moved: Sequence[Moved]
    ) -> tuple[list[Sighting], Tensor]:
        """As all do; what is out of reach is a problem."""
        seen, places = super()._look(batch, searches, moved)
        reaches = [self.model.reaches(place) for [place] in places]
        return [
            sighting if near or not sighting.thing else replace(sighting, problem=out_of_reach(sighting.name))
            for sighting, near in zip(seen, reaches, strict=True)
        ], places

    def get_optim_params(self) -> NoReturn:
        """There are none.

        Raises:
            ValueError: Always: LeRobot asks before it trains.
        """
        raise ValueError(NOTHING_TO_LEARN)

    def forward(self, batch: dict[str, Any], reduction: str = "mean") -> NoReturn:
        """There is no loss.

        Raises:
            ValueError: Always.
        """
        raise ValueError(NOTHING_TO_LEARN)
