# SPDX-License-Identifier: Apache-2.0
"""Somebody who moves the simulated robot's arms, to show it something: a person would do it by hand.

They know where the things stand: ground truth, which the robot that watches does not have.
"""

import numpy as np
import torch

from lerobot_owlxt5.commands.verbs import VERBS
from lerobot_owlxt5.motion_library import MotionLibrary
from nico_tabletop.nico_sim import NicoSim


def draw_movement(robot: NicoSim, random: np.random.Generator) -> list[np.ndarray]:
    """Draw what is done to which thing, among all that arms can do from home.

    Returns:
        Joint targets (joints,), degrees, one for each control period; none if all things are out of reach.
    """
    library, places = MotionLibrary(), robot.simulation.object_positions()[:, :2]
    possible = [
        motion
        for place in torch.from_numpy(places).float()
        for verb in VERBS
        if (motion := library.joint_targets(verb, place))
    ]
    if not possible:
        return []
    arm, targets = possible[random.integers(len(possible))]
    rest = library.rest.numpy()
    poses = np.repeat(rest[None], len(targets), axis=0)
    poses[:, arm] = targets.numpy()
    return [*poses]
