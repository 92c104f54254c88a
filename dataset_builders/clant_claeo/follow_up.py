# SPDX-License-Identifier: Apache-2.0
"""Demonstrations that follow another movement: they begin where it left the object and the arms.

A pull leaves an object between the fingers of a resting hand, where no placement puts one. People ask for the
opposite next, so a policy needs to have seen it (our decision).
"""

from dataclasses import replace

import numpy as np
import torch

from lerobot_owlxt5.way_home import way_back
from nico_tabletop.placement import OutOfReachError
from nico_tabletop.replay import replay
from nico_tabletop.robot import INITIAL_POSE_DEG
from nico_tabletop.scoring import Outcome
from nico_tabletop.simulation import TabletopSimulation
from nico_tabletop.tasks import Action

from .demonstrations import Demonstration

_DIGITS = 3  # of degrees, as of all conditions


def begin(simulation: TabletopSimulation, demonstration: Demonstration) -> Demonstration:
    """Carry out the movement that comes before a demonstration, if any, and go home as the policies do.

    Args:
        simulation: A world with the demonstration's objects.
        demonstration: At the places where they stand before that movement.

    Returns:
        The same demonstration, at the places and with the arms that the movement led to.

    Raises:
        OutOfReachError: If the movement before is not perfect.
    """
    if demonstration.before is None:
        return demonstration
    earlier = replace(demonstration, action=Action(demonstration.action.slot, demonstration.before))
    simulation.reset(earlier.arrangement, earlier.poses, earlier.conditions)
    if replay(simulation, earlier.action, earlier.joints) is not Outcome.PERFECT:
        raise OutOfReachError(f"{earlier.action.name} comes before, and is not perfect")
    home = way_back(torch.from_numpy(np.deg2rad(earlier.joints)))
    for target in np.rad2deg(home.numpy()):
        simulation.step(target)
    arms = simulation.joint_positions_deg - INITIAL_POSE_DEG
    conditions = replace(
        earlier.conditions,
        arms_deg=tuple(np.round(arms, _DIGITS).tolist()),
        shift_cm=((0.0, 0.0),) * len(earlier.poses),
    )
    return replace(demonstration, poses=simulation.object_poses(), conditions=conditions)
