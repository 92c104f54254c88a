# SPDX-License-Identifier: Apache-2.0
"""What is demonstrated: action, objects, joint trajectory and language, from the release or from a script."""

from collections.abc import Iterator
from dataclasses import dataclass, field
from functools import cached_property, lru_cache

import numpy as np
from numpy.typing import NDArray

from nico_tabletop.objects import read_objects
from nico_tabletop.placement import SLOT_POSES, Poses, find_placement
from nico_tabletop.starts import draw_conditions
from nico_tabletop.tasks import ACTIONS, VERBS, Action, Verb, arrangements, find_action
from nico_tabletop.variation import Conditions, Variation

from .release import Arrangement, Release, Split
from .sentences import sentence_about
from .wordings import wordings

_ARRANGEMENTS = 120  # of CLANT: all ordered triples of its six cubes
_OF_SENTENCES, _OF_CONDITIONS, _OF_FOLLOW_UPS = 1, 2, 3  # tell their random numbers from those of the poses


# The slots are the same in all arrangements: twelve plans serve 1440 demonstrations.
@lru_cache(maxsize=len(ACTIONS))
def _planned(action: Action, poses: Poses, conditions: Conditions) -> NDArray[np.float64]:
    from .expert import plan

    return plan(action, conditions.shifted(poses), conditions.start_pose_deg)


@dataclass(frozen=True, eq=False)
class Demonstration:
    """One episode before it is replayed.

    Attributes:
        action: What is done, and on which slot.
        arrangement: Names of the left, middle and right object.
        poses: Where they are placed.
        recorded: The release's trajectory, see `joints`; None: the expert plans one when it is asked for.
        wordings: The accepted commands, the canonical one first.
        translation: An English sentence and its German translation.
        split: `train` or `test`.
        conditions: In which way poses, arms, camera, light and table differ from the paper's setting.
        before: What is done to the same object first, unrecorded, see `follow_up`; None: nothing.
    """

    action: Action
    arrangement: Arrangement
    poses: Poses
    recorded: NDArray[np.float64] | None
    wordings: tuple[str, ...]
    translation: tuple[str, str]
    split: Split
    conditions: Conditions = field(default_factory=Conditions)
    before: Verb | None = None

    @property
    def task(self) -> str:
        """The canonical command."""
        return self.wordings[0]

    @cached_property
    def joints(self) -> NDArray[np.float64]:
        """Trajectory, float64 (T, 10), degrees, 10 rows a second, in the order of `robot.JOINT_NAMES`.

        Raises:
            OutOfReachError: If the scripted expert finds no way.
        """
        if self.recorded is not None:
            return self.recorded
        return _planned(self.action, self.poses, self.conditions)


def from_release(
    release: Release, objects: str = "clant", variation: Variation | None = None, seed: int = 0
) -> Iterator[Demonstration]:
    """The release's demonstrations, in its order.

    Objects other than `clant`'s take the places of the cubes, colour by colour in alphabetical order; the
    trajectories, the translations and the split stay those of the release (our decision).

    Args:
        release: The original release.
        objects: Name of a shipped set, such as `claeo`, or path of a YAML file; it has six objects.
        variation: How much the images may differ from the paper's setting; None: not at all.
        seed: Of these differences.

    Raises:
        ValueError: If the objects cannot be used or are not six, or arms or objects shall vary.
    """
    variation = variation or Variation()
    if variation.arms_deg or variation.shift_cm:
        raise ValueError(
            "the release's trajectories fit its start and its slots: --variation.arms_deg and "
            "--variation.shift_cm need --source=scripted"
        )
    items = {item.name: item for item in read_objects(objects)}
    cubes = [item.name for item in read_objects("clant")]
    if len(items) != len(cubes):
        raise ValueError(
            f"the release has {len(cubes)} objects, this set {len(items)}; a set of any size goes with "
            "--source=scripted"
        )
    stand_in = dict(zip(cubes, items, strict=True))
    for k, sample in enumerate(release.samples):
        action = find_action(sample.action)
        left, middle, right = (stand_in[name] for name in sample.arrangement)
        arrangement = (left, middle, right)
        words = sample.texts if objects == "clant" else wordings(action, items[arrangement[action.slot]])
        translation = (sample.english, sample.german)
        conditions = _conditions(variation, SLOT_POSES, seed, k)
        yield Demonstration(
            action, arrangement, SLOT_POSES, sample.joints, words, translation, sample.split, conditions
        )


def _conditions(variation: Variation, poses: Poses, seed: int, k: int) -> Conditions:
    """Conditions of the k-th demonstration."""
    return draw_conditions(variation, poses, np.random.default_rng((seed, k, _OF_CONDITIONS)))


def _spread(names: tuple[str, ...]) -> list[Arrangement]:
    """At most 120 arrangements, the same ones each time: of more, a seeded draw."""
    every = arrangements(names)
    if len(every) <= _ARRANGEMENTS:
        return every
    chosen = np.random.default_rng(0).choice(len(every), _ARRANGEMENTS, replace=False)
    return [every[index] for index in sorted(chosen)]


def _before(action: Action, follow_ups: float, random: np.random.Generator) -> Verb | None:
    """The verb of the movement before: none, or with the probability `follow_ups` another one."""
    others = [verb for verb in VERBS if verb != action.verb]
    drawn = others[random.integers(len(others))]
    return drawn if random.random() < follow_ups else None


def scripted(
    objects: str,
    placement: str = "slots",
    seed: int = 0,
    variation: Variation | None = None,
    follow_ups: float = 0.0,
) -> Iterator[Demonstration]:
    """The twelve actions in 120 arrangements, acted by the scripted expert.

    Six objects have just 120 arrangements; of more objects 120 are drawn, with a fixed seed, and fewer than
    six have fewer (our decision).

    Placements `free` and `mixed` (see `nico_tabletop.placement`) give the k-th demonstration poses of its
    own, drawn from `numpy.random.default_rng((seed, k))`: the same ones for all objects. Its sentence to
    translate is about its objects. Sentence and conditions are drawn from generators of their own: poses stay
    the same, whatever varies.

    Each action has 30 test episodes, as in the release: those whose arrangement's and action's numbers add up
    to a multiple of four (our decision).

    Args:
        objects: Name of a shipped set, such as `claeo`, or path of a YAML file.
        placement: `slots`, `free` or `mixed`.
        seed: Of the free placement, of the sentences and of the conditions.
        variation: How much each demonstration may differ from the paper's setting; None: not at all.
        follow_ups: Share of the demonstrations that follow another movement of the same object.

    Raises:
        ModuleNotFoundError: If the extra `scripted` (mink) is not installed.
        ValueError: If the objects cannot be used, there is no such placement, or it leaves no room for the
            variation.
    """
    from . import expert as expert  # fails now, not with the first trajectory, if mink is missing

    draw = find_placement(placement)
    items = {item.name: item for item in read_objects(objects)}
    for number, arrangement in enumerate(_spread(tuple(items))):
        for index, action in enumerate(ACTIONS):
            split: Split = "test" if (number + index) % 4 == 0 else "train"
            words = wordings(action, items[arrangement[action.slot]])
            k = len(ACTIONS) * number + index
            poses = draw(np.random.default_rng((seed, k)))
            sentence = sentence_about(arrangement, np.random.default_rng((seed, k, _OF_SENTENCES)))
            conditions = _conditions(variation or Variation(), poses, seed, k)
            before = _before(action, follow_ups, np.random.default_rng((seed, k, _OF_FOLLOW_UPS)))
            yield Demonstration(action, arrangement, poses, None, words, sentence, split, conditions, before)
