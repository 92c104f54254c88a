# SPDX-License-Identifier: Apache-2.0
"""The cells of `robustness.py`: in which way each differs from the paper's setting, and what it asks for.

All numbers are our decision. A cell draws an episode from the seed, the action and the scene's number alone:
every policy meets the same ones. The objects of a scene are the same in all cells.
"""

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from itertools import combinations

import numpy as np

from nico_tabletop.objects import TabletopObject
from nico_tabletop.placement import CLEARANCE, Pose, Poses, find_placement
from nico_tabletop.starts import draw_conditions, hands_are_clear
from nico_tabletop.tasks import ACTIONS, SLOTS, VERBS, Action
from nico_tabletop.variation import Conditions, Variation

STROKE = 0.06
"""So far an object moves, metres: the room that a later command has is reckoned with it."""

Random = np.random.Generator


@dataclass(frozen=True)
class Episode:
    """How an episode begins, and what is asked for.

    Attributes:
        arrangement: Names of the left, middle and right object.
        poses: Where they are placed.
        conditions: In which way the start differs from the paper's.
        commands: What is judged, one after the other; a command comes when the one before was reported.
        first: What is asked for before that; `EPISODE_STEPS` steps later the others begin, whatever the robot
            is doing then. It is not judged.
        seed: Of what happens later.
    """

    arrangement: tuple[str, ...]
    poses: Poses
    conditions: Conditions
    commands: tuple[Action, ...]
    first: Action | None
    seed: int


Commands = tuple[Action | None, tuple[Action, ...]]


def _alone(action: Action, poses: Poses, random: Random) -> Commands:
    return None, (action,)


def _after_another(action: Action, poses: Poses, random: Random) -> Commands:
    """After a command about another object."""
    others = [each for each in ACTIONS if each.slot != action.slot and has_room(poses, [each, action])]
    return others[random.integers(len(others))], (action,)


def _after_its_opposite(action: Action, poses: Poses, random: Random) -> Commands:
    """After the opposite command about the same object."""
    x, y = action.verb.direction
    [opposite] = (verb for verb in VERBS if verb.direction == (-x, -y))
    return Action(action.slot, opposite), (action,)


def _in_a_row(action: Action, poses: Poses, random: Random) -> Commands | None:
    """One about each object; None if these have not found room for each other."""
    verbs = [VERBS[index] for index in random.integers(len(VERBS), size=len(SLOTS))]
    verbs[action.slot] = action.verb
    commands = tuple(Action(int(slot), verbs[slot]) for slot in random.permutation(len(SLOTS)))
    return (None, commands) if has_room(poses, commands) else None


def has_room(poses: Sequence[Pose], commands: Sequence[Action]) -> bool:
    """Whether objects are `CLEARANCE` apart before each command, as they are when they are placed."""
    places = np.array([pose[:2] for pose in poses])
    for action in commands:
        if any(np.linalg.norm(places[a] - places[b]) < CLEARANCE for a, b in combinations(range(3), 2)):
            return False
        places[action.slot] += STROKE * np.array(action.verb.direction)
    return True


def _as_usual(poses: Poses, random: Random) -> Conditions:
    return Conditions()


def _varied(variation: Variation) -> Callable[[Poses, Random], Conditions]:
    return lambda poses, random: draw_conditions(variation, poses, random)


def _always(conditions: Conditions) -> Callable[[Poses, Random], Conditions]:
    return lambda poses, random: conditions


def _noisy(poses: Poses, random: Random) -> Conditions:
    return Conditions(noise=8, seed=int(random.integers(2**31)))


def _off(distance: float) -> Callable[[Poses, Random], Conditions]:
    """All objects so many centimetres off, in random directions that keep clear of hands and each other."""

    def draw(poses: Poses, random: Random) -> Conditions:
        while True:
            angle = random.uniform(0, 2 * np.pi, len(SLOTS))
            shift = distance * np.stack([np.cos(angle), np.sin(angle)], axis=1)
            conditions = Conditions(shift_cm=tuple((float(x), float(y)) for x, y in shift))
            if hands_are_clear(poses, conditions):
                return conditions

    return draw


@dataclass(frozen=True)
class Cell:
    """One row of the table.

    Attributes:
        about: What it is, in a few words.
        placement: As the environment's.
        conditions: Draws in which way the start differs from the paper's.
        commands: Draws what is asked for; None: draw again, the places too.
        displaced_cm: So far the object is moved aside at step `DISPLACED_AT`.
        replan_every: The policy's option.
        weak: The arms carry out a share of the movement alone, so that most of them fail.
    """

    about: str
    placement: str = "slots"
    conditions: Callable[[Poses, Random], Conditions] = _as_usual
    commands: Callable[[Action, Poses, Random], Commands | None] = _alone
    displaced_cm: float = 0.0
    replan_every: int = 0
    weak: bool = False

    def draw(self, objects: Sequence[TabletopObject], action: Action, scene: int, seed: int = 0) -> Episode:
        """Draw one of the cell's episodes: that of an action in its n-th scene."""
        random = np.random.default_rng((seed, ACTIONS.index(action), scene))
        names = np.array([item.name for item in objects])
        arrangement = tuple(random.choice(names, len(SLOTS), replace=False).tolist())
        commands = None
        while commands is None:
            poses = find_placement(self.placement)(random)
            commands = self.commands(action, poses, random)
        first, judged = commands
        conditions = self.conditions(poses, random)
        return Episode(arrangement, poses, conditions, judged, first, int(random.integers(2**31)))


DISPLACED_AT = 10
"""At this step of a movement an object is moved aside."""

CELLS: dict[str, Cell] = {
    "slots": Cell("canonical commands on the slots"),
    "free": Cell("placed freely", placement="free"),
    "second": Cell("a second command at once", commands=_after_another),
    "opposite": Cell("the opposite command at once", commands=_after_its_opposite),
    "three": Cell("three commands in a row, placed freely", placement="free", commands=_in_a_row),
    "arms5": Cell("arms up to 5° off", conditions=_varied(Variation(arms_deg=5))),
    "arms10": Cell("arms up to 10° off", conditions=_varied(Variation(arms_deg=10))),
    **{f"off{cm}": Cell(f"objects {cm} cm off their slots", conditions=_off(cm)) for cm in (1, 2, 3, 4)},
    "dark": Cell("light at a tenth", conditions=_always(Conditions(light=0.1))),
    "nearer": Cell("camera 2 cm nearer", conditions=_always(Conditions(camera_cm=(0, 0, -2)))),
    "yaw_left": Cell("camera turned 3° to the left", conditions=_always(Conditions(camera_deg=(0, 3, 0)))),
    "yaw_right": Cell("camera turned 3° to the right", conditions=_always(Conditions(camera_deg=(0, -3, 0)))),
    "white": Cell("a white table", conditions=_always(Conditions(table=(1, 1, 1)))),
    "noise": Cell("noise, 8 grey levels", conditions=_noisy),
    "blur": Cell("blur, 1.5 pixels", conditions=_always(Conditions(blur=1.5))),
    "jpeg": Cell("JPEG, quality 30", conditions=_always(Conditions(jpeg=30))),
    "displaced": Cell("moved 3 cm aside at step 10", displaced_cm=3),
    "replan": Cell("the same, replan_every=5", displaced_cm=3, replan_every=5),
    "weak": Cell("arms that do a share of the movement", weak=True),
}
